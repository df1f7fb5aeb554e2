"""Where a ball is at given times: free flight, and the table where it comes down on it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics.contact import come_down, over_table
from core.physics.flight import Air, fly
from core.physics.impact import Surface, strike

Array = NDArray[np.float64]


@njit
def positions_at(start: Array, t_s: Array, air: Air, table: Surface, ps_m: Array) -> None:
    """Write to `ps_m` (N, 3) where a ball that starts as `start` (9,) is at the times `t_s` (N,) >= 0, ascending.

    It bounces on the table's top as often as it comes down there; net, racket and floor are not in the way.
    """
    s, landed = start.copy(), np.empty(9)
    now = 0.0
    wait = come_down(s, air, landed)
    bounce = now + wait if not math.isnan(wait) and over_table(landed[0], landed[1]) else math.inf
    for n in range(len(t_s)):
        while bounce <= t_s[n]:
            s[:] = landed
            strike(s, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), table)
            now = bounce
            wait = come_down(s, air, landed)
            later = not math.isnan(wait) and wait > 1e-6 and over_table(landed[0], landed[1])
            bounce = now + wait if later else math.inf
        left = t_s[n] - now
        steps = max(1, math.ceil(left / air.step_s))
        for _ in range(steps):
            fly(s, left / steps, air, s)
        now = t_s[n]
        ps_m[n, 0], ps_m[n, 1], ps_m[n, 2] = s[0], s[1], s[2]
