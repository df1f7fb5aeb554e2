"""The detections of all cameras at one time, as their windows and pictures end at times of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras.stereo import interpolate_pixels
from core.detection import Detection


class AlignedPixels(NamedTuple):
    """What the cameras (C) see at one time; nan where one sees nothing, or does not say how well."""

    t_us: int
    uvs_px: NDArray[np.float64]
    """(C, 2)."""
    covariances_px2: NDArray[np.float64]
    """(C, 2, 2)."""


class TimeAligner:
    """Remembers the last two detections of each camera and reads all at the latest time that two have reached."""

    def __init__(self, names: tuple[str, ...], max_lag_us: int) -> None:
        self._names = names
        self._max_lag_us = max_lag_us
        self.reset()

    def reset(self) -> None:
        """Forget all detections."""
        self._last: dict[str, list[Detection]] = {name: [] for name in self._names}
        self._given_us = -1
        self._waiting: list[tuple[str, Detection]] = []
        self._taken: list[tuple[str, Detection]] = []

    def add(self, detections: Mapping[str, Detection | None]) -> AlignedPixels | None:
        """The pixels of all cameras at a new common time; None without two of them."""
        new = {name: found for name, found in detections.items() if found is not None}
        if not new:
            return None
        for name, found in new.items():
            self._last[name] = [*self._last[name][-1:], found]
            self._waiting.append((name, found))
        newest = sorted((track[-1].t_us for track in self._last.values() if track), reverse=True)
        # The latest time that two cameras have reached; a third that fell behind does not hold them up.
        t_us = newest[1] if len(newest) > 1 else self._given_us
        if t_us <= self._given_us:
            return None
        uvs = np.array([self._read(name, t_us) for name in self._names])
        if np.isfinite(uvs[:, 0]).sum() < 2:
            return None
        self._given_us = t_us
        read = {name for name, uv in zip(self._names, uvs, strict=True) if np.isfinite(uv[0])}
        self._taken = [one for one in self._waiting if one[0] in read and one[1].t_us <= t_us]
        self._waiting = [one for one in self._waiting if one[0] not in read or one[1].t_us > t_us]
        return AlignedPixels(t_us, uvs, np.array([self._covariance(name) for name in self._names]))

    def put_back(self) -> None:
        """Take the newest common time for none: its detections were not of one ball."""
        self._waiting, self._taken = [*self._taken, *self._waiting], []

    def take_lone(self) -> list[tuple[str, Detection]]:
        """Detections that no longer can be brought to one time with another camera's, in order of time; each once."""
        lone = [one for one in self._waiting if self._is_lone(*one)]
        self._waiting = [one for one in self._waiting if not self._is_lone(*one)]
        return sorted(lone, key=lambda one: one[1].t_us)

    def _is_lone(self, name: str, found: Detection) -> bool:
        """Whether the common time has passed it, two newer ones took its place, or all others fell far behind."""
        others = max((track[-1].t_us for other, track in self._last.items() if track and other != name), default=0)
        replaced = all(found is not one for one in self._last[name])
        return found.t_us <= self._given_us or replaced or found.t_us - others > self._max_lag_us

    def replace(self, name: str, found: Detection) -> None:
        """Put a better detection in the place of the camera's newest one."""
        self._last[name] = [*self._last[name][:-1], found]

    def _covariance(self, name: str) -> NDArray[np.float64]:
        """(2, 2) of the camera's newest detection."""
        track = self._last[name]
        stated = track[-1].centre_covariance_px2 if track else None
        return np.full((2, 2), np.nan) if stated is None else stated

    def _read(self, name: str, t_us: int) -> NDArray[np.float64]:
        track = self._last[name]
        for found in track:
            if found.t_us == t_us:
                return np.array([found.u_px, found.v_px])
        times = [found.t_us for found in track]
        uvs = [(found.u_px, found.v_px) for found in track]
        return interpolate_pixels(times, uvs, t_us, max_gap_us=self._max_lag_us)[0]
