"""Whether the cameras still fit each other, from the ball points of the last flights: an alarm if one was moved."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.stereo import EpipolarDrift, EpipolarPair
from core.chain.chain import ChainState
from core.config import check_settings, setting
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
HIGHEST_M: Final = 0.5
"""Height of the volume above the table: as high as most balls fly."""
FEWEST_PLACES: Final = 20
"""Fewest places over the table, of 385, that both cameras of a pair have to see. Chosen by hand; not measured."""
OTHERS_FIT: Final = (0.5, 0.25)
"""A camera is named if the pairs without it fit, and have drifted by less than such a share of the worst (choice).
The second share decides where the first leaves several: a turn along a pair's epipolar lines is hardly seen by it."""
MAX_CAMERAS: Final = 8
"""Pairs among the first so many are looked at: 28 pairs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationDriftConfig:
    """When the calibration is no longer believed. Tuned on simulated rallies with cameras turned by known angles."""

    alarm_px: float = setting(0.42, 0.05, 20.0)
    """A drift that is surely greater raises the alarm: one of 1 px has to, one of .3 px must not."""
    sure_sigmas: float = setting(2.0, 0.0, 10.0)
    """Surely: by so many of its standard deviations. Early readings, of few points, are the ones that err far."""
    volume_share: float = setting(0.3, 0.0, 1.0)
    """The drift over the volume above the table counts so much, and the rest what is seen where the balls fly: the
    first is less well known, the second may be small where a great one is elsewhere."""
    over_px: float = setting(0.4, 0.05, 20.0)
    """Below it, sure or not, the alarm is over."""
    every_ms: float = setting(10.0, 0.1, 1000.0)
    """Points closer together than that err alike, and are not counted."""
    points_at_least: int = setting(200, 10, 10_000)
    """With fewer, nothing is said: some four flights."""
    points: int = setting(400, 10, 10_000)
    """The newest ones count: some eight flights."""
    judged_every: int = setting(20, 1, 1000)
    """New points between two looks."""
    largest_sigma_px: float = setting(0.15, 0.01, 5.0)
    """A drift that is known no better is not judged: the cameras see different things."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class DriftReport:
    """What is known of the fit of the cameras, of the pair that fits worst."""

    points: int = 0
    """That it rests on."""
    needed: int = 0
    """Points before anything is said."""
    pair: tuple[str, str] | None = None
    drift: EpipolarDrift | None = None
    """None as long as nothing is said."""
    alarm: bool = False
    camera: str | None = None
    """The one of three cameras or more that was moved: all pairs without it fit. None if that is not so of one only."""
    camera_px: float = 0.0
    """By so much its picture is surely off."""

    @property
    def distrusted(self) -> tuple[str | None, float]:
        """The arguments of `RallyChain.distrust`: who is named while the alarm rings."""
        return (self.camera, self.camera_px) if self.alarm else (None, 0.0)


class CalibrationDrift:
    """Used by the thread of the chain; `report` may be read by any.

    A point counts if the gate took it, or if its rays missed each other: after a great drift there is no other.
    """

    def __init__(self, cameras: Mapping[str, Camera], config: CalibrationDriftConfig | None = None) -> None:
        self.config = config or CalibrationDriftConfig()
        self._names = tuple(cameras)
        self._pairs = {
            (a, b): _PairPoints(cameras[a], cameras[b], self.config)
            for a, b in combinations(self._names[:MAX_CAMERAS], 2)
        }
        self.report = DriftReport(needed=self.config.points_at_least)

    def add(self, state: ChainState) -> DriftReport:
        """Take one step of the chain."""
        pixels = state.pixels
        if pixels is None or state.verdict == "stray":
            return self.report
        return self.add_pixels(pixels.t_us, dict(zip(self._names, pixels.uvs_px, strict=True)))

    def add_pixels(self, t_us: int, uvs_px: Mapping[str, Array]) -> DriftReport:
        """Take what the cameras saw at one time; nan: nothing."""
        judged = False
        for (a, b), points in self._pairs.items():
            if np.isfinite(uvs_px[a]).all() and np.isfinite(uvs_px[b]).all():
                judged |= points.add(t_us, np.concatenate([uvs_px[a], uvs_px[b]]))
        most = max(len(points.rows) for points in self._pairs.values())
        if judged:
            self.report = self._judge(most)
        elif self.report.drift is None and most != self.report.points:
            self.report = DriftReport(most, self.config.points_at_least)
        return self.report

    def _judge(self, most: int) -> DriftReport:
        found = {pair: points.drift for pair, points in self._pairs.items() if points.drift is not None}
        if not found:
            return DriftReport(most, self.config.points_at_least, alarm=self.report.alarm)
        pair, worst = max(found.items(), key=lambda item: self._surely_px(item[1]))
        goes_on = self.report.alarm and self._drift_px(worst, 0.0) > self.config.over_px
        surely_px = {two: max(self._surely_px(drift), 0.0) for two, drift in found.items()}
        camera, camera_px = _moved_camera(surely_px, self.config.over_px)
        alarm = goes_on or max(surely_px[pair], camera_px) > self.config.alarm_px
        points = len(self._pairs[pair].rows)
        return DriftReport(points, self.config.points_at_least, pair, worst, alarm, camera, camera_px)

    def _surely_px(self, drift: EpipolarDrift) -> float:
        return self._drift_px(drift, self.config.sure_sigmas)

    def _drift_px(self, drift: EpipolarDrift, less_sigmas: float) -> float:
        here_px = drift.drift_px - less_sigmas * drift.sigma_px
        if drift.elsewhere_px is None:
            return here_px
        there_px = drift.elsewhere_px - less_sigmas * drift.elsewhere_sigma_px
        return here_px + self.config.volume_share * (there_px - here_px)


def _moved_camera(drifts_px: Mapping[tuple[str, str], float], fits_px: float) -> tuple[str | None, float]:
    """The camera whose pairs alone have drifted, and by how much its picture is off, in any direction.

    A shift of a picture is seen by a pair only across its epipolar lines: in the mean of all directions, half of its
    square. (None, 0) if the pairs without a camera fit badly too, are unknown, or fit without several cameras.
    """
    names = {name for pair in drifts_px for name in pair}
    for share in OTHERS_FIT:
        limit_px = min(fits_px, share * max(drifts_px.values()))
        moved: list[tuple[str, float]] = []
        for name in names:
            others = [px for pair, px in drifts_px.items() if name not in pair]
            own = [px for pair, px in drifts_px.items() if name in pair]
            if others and len(own) > 1 and max(others) < limit_px:
                moved.append((name, float(np.sqrt(2.0 * np.mean(np.square(own))))))
        if len(moved) == 1:
            return moved[0]
    return None, 0.0


def _volume(first: Camera, second: Camera) -> Array | None:
    """(N, 3) places above the table that both see; None if those are few: they look elsewhere, or know no table."""
    axes = (np.linspace(-x, x, n) for x, n in ((TABLE_LENGTH_M / 2, 11), (TABLE_WIDTH_M / 2, 7)))
    ps = np.stack(np.meshgrid(*axes, np.linspace(0.02, HIGHEST_M, 5)), axis=-1).reshape(-1, 3)
    seen = np.ones(len(ps), np.bool_)
    for camera in (first, second):
        size = np.array([camera.sensor.width_px, camera.sensor.height_px])
        uvs = camera.project(ps)
        with np.errstate(invalid="ignore"):
            seen &= ((uvs > -0.5) & (uvs < size - 0.5)).all(axis=1)
    return ps[seen] if seen.sum() >= FEWEST_PLACES else None


class _PairPoints:
    """The newest sightings of two cameras."""

    def __init__(self, first: Camera, second: Camera, config: CalibrationDriftConfig) -> None:
        self._pair, self._config = EpipolarPair(first, second), config
        volume = _volume(first, second)
        self._elsewhere = None if volume is None else self._pair.slopes_px(volume)
        self.rows: deque[Array] = deque(maxlen=config.points)
        """(4,) each: u, v of the first and of the second."""
        self.drift: EpipolarDrift | None = None
        self._last_us = -(1 << 62)
        self._new = 0

    def add(self, t_us: int, row: Array) -> bool:
        """Whether it was judged anew."""
        config = self._config
        if 0 <= t_us - self._last_us < 1000 * config.every_ms:
            return False
        self._last_us = t_us
        self.rows.append(row)
        self._new += 1
        if len(self.rows) < config.points_at_least or self._new < config.judged_every:
            return False
        self._new = 0
        rows = np.array(self.rows)
        found = self._pair.fit(rows[:, :2], rows[:, 2:], self._elsewhere)
        self.drift = found if found.sigma_px <= config.largest_sigma_px else None
        return True
