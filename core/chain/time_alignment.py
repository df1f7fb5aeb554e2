"""Bringing the newest detections of all cameras to one time: a difference in time would go straight into the depth."""

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

    def add(self, detections: Mapping[str, Detection | None]) -> AlignedPixels | None:
        """The pixels of all cameras at a new common time; None without two of them."""
        new = {name: found for name, found in detections.items() if found is not None}
        if not new:
            return None
        for name, found in new.items():
            self._last[name] = [*self._last[name][-1:], found]
        newest = sorted((track[-1].t_us for track in self._last.values() if track), reverse=True)
        # The latest time that two cameras have reached; a third that fell behind does not hold them up.
        t_us = newest[1] if len(newest) > 1 else self._given_us
        if t_us <= self._given_us:
            return None
        uvs = np.array([self._read(name, t_us) for name in self._names])
        if np.isfinite(uvs[:, 0]).sum() < 2:
            return None
        self._given_us = t_us
        return AlignedPixels(t_us, uvs, np.array([self._covariance(name) for name in self._names]))

    def replace(self, name: str, found: Detection) -> None:
        """Put a better detection in the place of the camera's newest one."""
        self._last[name] = [*self._last[name][:-1], found]

    def _covariance(self, name: str) -> NDArray[np.float64]:
        """(2, 2) of the camera's newest detection."""
        track = self._last[name]
        said = track[-1].centre_covariance_px2 if track else None
        return np.full((2, 2), np.nan) if said is None else said

    def _read(self, name: str, t_us: int) -> NDArray[np.float64]:
        track = self._last[name]
        for found in track:
            if found.t_us == t_us:
                return np.array([found.u_px, found.v_px])
        times = [found.t_us for found in track]
        uvs = [(found.u_px, found.v_px) for found in track]
        return interpolate_pixels(times, uvs, t_us, max_gap_us=self._max_lag_us)[0]
