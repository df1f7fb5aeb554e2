"""One camera carries a flight on: a detection without a partner moves the trajectory filter at its own time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, StereoRig
from core.chain.config import ChainConfig
from core.chain.size_check import SizeCheck
from core.detection import Detection
from core.trajectory import FilterPredictor, PixelObservation

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class BallPoint:
    """The ball in space."""

    t_us: int
    """When: the cameras' common time, or that of the one camera."""
    p_world_m: Array
    residual_px: float
    covariance_m2: Array
    """(3, 3): of several cameras from their pixel noise; of one camera that of the flight's estimate, with what the
    points of a flight err in common."""
    uvs_px: dict[str, tuple[float, float]]
    """The pixels it was made of, by camera, at `t_us`: of every camera that sees the ball where the others do. One
    camera alone says nothing of the distance; that is the flight's."""


class SingleView:
    """Feeds the filter with what only one camera sees, as `SingleViewConfig` says."""

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        rig: StereoRig,
        config: ChainConfig,
        predictor: FilterPredictor,
        size: SizeCheck | None,
    ) -> None:
        """With `size`, circles of a wrong size at the expected place are left out."""
        self.predictor = predictor
        self._cameras, self._rig, self._size = dict(cameras), rig, size
        self._config = config.single_view
        self._sigma_px = config.triangulation.sigma_px
        self._max_late_us = round(1000 * config.max_lag_ms)
        self.distrusted: tuple[str | None, float] = (None, 0.0)
        """See `RallyChain.distrust`."""
        self.exposures_us: dict[str, int] = {}
        """Length of the newest picture of each frame camera: its answer, of mid exposure, is known so much later."""
        self.forget_flight()

    def forget_flight(self) -> None:
        """Expect a new flight, which several cameras have to begin."""
        self._several_us: int | None = None
        self.used: dict[str, tuple[float, float]] = {}
        """Pixels by camera that moved the estimate at the last `follow`, each of a time of its own."""

    def note_several(self, t_us: int) -> None:
        """Take note of a point of several cameras."""
        self._several_us = t_us

    def follow(self, lone: Sequence[tuple[str, Detection]]) -> BallPoint | None:
        """Feed the predictor with lone detections in order of time; where the newest of those that fit puts the ball.

        None if none fits, or the place is not known well enough.
        """
        newest: tuple[str, Detection] | None = None
        self.used = {}
        for name, found in lone:
            late = found.t_us <= self.predictor.newest_us
            if self._take(name, found):
                self.used[name] = found.u_px, found.v_px
                newest = newest if late else (name, found)
        position = self.predictor.position()
        if newest is None or position is None:
            return None
        since_ms = 1e-3 * (newest[1].t_us - (self._several_us or 0))
        p, covariance = position.p_world_m, position.covariance_m2 + self._common_m2(since_ms)
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        if not sigma_m <= 1e-3 * self._config.largest_sigma_mm:
            return None
        name, found = newest
        uv = found.u_px, found.v_px
        away_px = float(np.linalg.norm(self._cameras[name].project(p)[0] - uv))
        return BallPoint(found.t_us, p, away_px, covariance, {name: uv})

    def _common_m2(self, since_ms: float) -> Array:
        """(3, 3) covariance of what all points of the flight err alike and the filter does not know of."""
        up_mm = np.hypot(self._config.offset_mm, self._config.offset_mmps * 1e-3 * since_ms)
        covariance = np.diag([0.0, 0.0, (1e-3 * up_mm) ** 2])
        velocity = self.predictor.state[3:6]
        speed = float(np.linalg.norm(velocity))
        # As much as `ahead_m` is in the filter's covariance already.
        beyond_m2 = (1e-6 * self._config.delay_us * speed) ** 2 - self.predictor.config.ahead_m**2
        if beyond_m2 > 0:
            covariance += beyond_m2 * np.outer(velocity / speed, velocity / speed)
        return covariance

    def _take(self, name: str, found: Detection) -> bool:
        """Whether the detection moved the estimate."""
        position = self.predictor.position()
        since = self._several_us
        if position is None or since is None or found.t_us - since > 1000 * self._config.longest_ms:
            return False
        if self._size is not None and self._size.wrong(position.p_world_m, {name: found.r_px}):
            return False
        known = found.centre_covariance_px2
        noise = self._sigma_px**2 * np.eye(2) if known is None else known
        off_px = self.distrusted[1] if name == self.distrusted[0] else 0.0
        seen = PixelObservation(
            np.array([found.u_px, found.v_px]),
            noise + (self._config.floor_px**2 + off_px**2) * np.eye(2),
            self._rig.camera_arrays(name),
            self._config.gate_sigmas**2,
        )
        max_late_us = self._max_late_us + self.exposures_us.get(name, 0)
        return self.predictor.add_pixel(found.t_us, seen, max_late_us=max_late_us)
