"""Many flights at once, each with its own constants: positions at given times, and the first contact.

A row is (13,): position, velocity, spin, drag coefficient, restitution and friction of the table, share of the speed
that a net gives back. The rules of contact are those of `core.physics.contact`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.jit import njit
from core.physics import contact
from core.physics.contact import come_down, cross_net_plane, highest_point, next_contact
from core.physics.flight import Air, rk4_step
from core.physics.impact import Surface, strike
from core.table import BALL_RADIUS_M
from core.trajectory.ball_kernel import DRAG_PER_M

Array = NDArray[np.float64]
ROW: Final = 13
DRAG, RESTITUTION, FRICTION, NET_SHARE = 9, 10, 11, 12
STEP_S: Final = 0.010
"""Step of a flight: with air, exact to a few micrometres."""
NET_ALONG: Final = 0.5
"""Share of the speed along the net that is left after a touch."""
FOUND: Final = 14
"""What `look_ahead` writes: landing time, position, velocity; height at the net; when it is over the net plane; first
contact: its code, time, position."""


@njit
def glide(s: Array, seconds: float, lift: float) -> None:
    """Move position and velocity of a row through the air, forwards or back in time."""
    left = abs(seconds)
    sign = 1.0 if seconds >= 0 else -1.0
    while left > 1e-12:
        h = min(left, STEP_S)
        rk4_step(s, sign * h, DRAG_PER_M * s[DRAG], lift, s)
        left -= h


@njit
def places_along(rows: Array, t_s: Array, lift: float, ps_m: Array) -> None:
    """Write to `ps_m` (N, K, 3) where each row (N, 13) at time 0 is at ascending times (K,): there is no table here."""
    s = np.empty(ROW)
    for i in range(len(rows)):
        s[:] = rows[i]
        now = 0.0
        for k in range(len(t_s)):
            glide(s, t_s[k] - now, lift)
            now = t_s[k]
            ps_m[i, k] = s[:3]


@njit
def look_ahead(rows: Array, lift: float, found: Array) -> None:
    """Write to `found` (N, 14) the landing and first contact of each row (N, 13), see `FOUND`; times are relative to
    the rows.
    """
    state = np.empty(9)
    for i in range(len(rows)):
        s = rows[i, :9]
        air = Air(DRAG_PER_M * rows[i, DRAG], lift, 0.004, lift > 0.0 or rows[i, DRAG] > 0.0)
        t = come_down(s, air, state)
        if math.isnan(t):
            t = highest_point(s, air, state)
        found[i, 0] = t
        found[i, 1:7] = state[:6]
        found[i, 7] = found[i, 8] = math.nan
        if s[0] < 0 and s[3] > 0:
            t = cross_net_plane(s, air, state)
            if not math.isnan(t):
                found[i, 7], found[i, 8] = state[2], t
        what, t = next_contact(s, air, state)
        found[i, 9], found[i, 10] = what, t
        found[i, 11:14] = state[:3]


@njit
def places_after(rows: Array, what: Array, contact_s: Array, t_s: Array, lift: float, ps_m: Array) -> None:
    """Write to `ps_m` (N, K, 3) each row's positions at ascending times (K,), after bouncing off its first contact."""
    s = np.empty(ROW)
    for i in range(len(rows)):
        s[:] = rows[i]
        now, touched = 0.0, False
        for k in range(len(t_s)):
            if not touched and t_s[k] > contact_s[i]:
                glide(s, contact_s[i] - now, lift)
                now, touched = contact_s[i], True
                _leave(s, int(what[i]))
            glide(s, t_s[k] - now, lift)
            now = t_s[k]
            ps_m[i, k] = s[:3]


@njit
def _leave(s: Array, what: int) -> None:
    if what in (contact.OWN_TOP, contact.FAR_TOP):
        strike(s, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), Surface(s[RESTITUTION], 0.0, 0.0, 0.0, s[FRICTION], 1.0))
        s[2] = BALL_RADIUS_M
    elif what in (contact.NET, contact.OWN_END, contact.FAR_END):
        s[3] *= -s[NET_SHARE]
        s[4] *= NET_ALONG
        s[5] *= NET_ALONG
    elif what == contact.FLOOR:
        s[3:6] = 0.0
