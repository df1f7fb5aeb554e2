"""Which points are of the flight that is watched, which begin a new one, and which are neither."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from core.chain.config import TrackGateConfig

Verdict = Literal["new flight", "same flight", "stray", "struck"]
"""`new flight`: forget the one before; `struck`: too, and nothing more of this ball concerns the robot."""


class TrackGate:
    """Judges points one by one."""

    def __init__(self, config: TrackGateConfig) -> None:
        self._config = config
        self.reset()

    def reset(self) -> None:
        """Expect a new flight."""
        self._last: tuple[int, NDArray[np.float64]] | None = None
        self._stray: tuple[int, NDArray[np.float64]] | None = None
        self._strays = 0
        self._nearest_x_m = np.inf
        self._struck = False

    def judge(self, t_us: int, p_world_m: NDArray[np.float64]) -> Verdict:
        """What this point is; strays change nothing."""
        if self._last is None or t_us - self._last[0] > 1000 * self._config.gap_ms:
            return self._begin(t_us, p_world_m)
        if not self._reachable(self._last, t_us, p_world_m):
            agrees = self._stray is not None and self._reachable(self._stray, t_us, p_world_m)
            self._strays = self._strays + 1 if agrees else 1
            self._stray = (t_us, p_world_m)
            return self._begin(t_us, p_world_m) if self._strays >= self._config.restart_points else "stray"
        self._last, self._stray, self._strays = (t_us, p_world_m), None, 0
        self._nearest_x_m = min(self._nearest_x_m, float(p_world_m[0]))
        self._struck = self._struck or p_world_m[0] > self._nearest_x_m + self._config.turn_m
        return "struck" if self._struck else "same flight"

    def _begin(self, t_us: int, p: NDArray[np.float64]) -> Verdict:
        self.reset()
        self._last, self._nearest_x_m = (t_us, p), float(p[0])
        return "new flight"

    def _reachable(self, start: tuple[int, NDArray[np.float64]], t_us: int, p: NDArray[np.float64]) -> bool:
        most_m = self._config.tolerance_m + self._config.max_speed_mps * (t_us - start[0]) * 1e-6
        return float(np.linalg.norm(p - start[1])) <= most_m
