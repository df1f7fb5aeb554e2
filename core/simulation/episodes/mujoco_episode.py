"""The one-step task played in MuJoCo: the same arrays in and out as the closed form, one ball after the other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.physics.episode import Case, Outcomes, Serves, Strokes
from core.physics.flight import MAX_FLIGHT_S
from core.physics.rotation import normals_from_orientations
from core.physics.task import TaskConfig
from core.simulation.episodes.ball_outcome import case_of
from core.simulation.episodes.closed_form import fly_serves
from core.simulation.episodes.mujoco_rally import MujocoRally
from core.simulation.episodes.racket import RacketState
from core.simulation.episodes.rally_events import RallyEvent
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]


def simulate_episodes_mujoco(serves: Serves, strokes: Strokes, config: TaskConfig, *, dt_s: float = 0.01) -> Outcomes:
    """What `simulate_episodes` gives, stepped in MuJoCo with event-driven impacts.

    The racket coasts with the stroke's velocity, without limits. After the stroke the ball flies on through table and
    net, so that landing and height at the net are read off the same flight.
    """
    aim_p, aim_t = strokes.aim_ps_m, strokes.aim_t_s
    if aim_p is None or aim_t is None:
        arrivals = fly_serves(serves, config)
        aim_p, aim_t = arrivals.states[:, :3], arrivals.t_s
    normals = normals_from_orientations(strokes.qs_wxyz)
    n = len(serves)
    outcomes = Outcomes(
        np.full(n, Case.MISSED, np.int8),
        *(np.full(shape, np.nan) for shape in (n, (n, 9), n, (n, 9), n, n, (n, 9))),
    )
    rally = MujocoRally(config, dt_s=dt_s, ghost_after_hit=True)
    for i in range(n):
        if math.isnan(aim_t[i]):
            continue
        face = aim_p[i] - BALL_RADIUS_M * normals[i] - strokes.vs_mps[i] * aim_t[i]
        racket = RacketState(face, strokes.vs_mps[i], strokes.qs_wxyz[i], np.zeros(3))
        _play(rally, racket, i, serves, outcomes)
    return outcomes


def _play(rally: MujocoRally, racket: RacketState, i: int, serves: Serves, outcomes: Outcomes) -> None:
    rally.reset()
    rally.coast_racket(racket)
    rally.serve(serves.ps_m[i], serves.vs_mps[i], serves.spins_radps[i])
    hit: RallyEvent | None = None
    flight: list[RallyEvent] = []
    while rally.playing and rally.time_s < 2 * MAX_FLIGHT_S:
        for event in rally.step():
            if event.kind == "hit" and hit is None:
                hit = event
            elif hit is not None:
                flight.append(event)
        if hit is not None and _is_over(flight, hit, rally.time_s):
            break
        if hit is None and rally.ball[2] < -0.5:
            break
    if hit is not None:
        _record(i, hit, flight, outcomes)


def _is_over(flight: list[RallyEvent], hit: RallyEvent, now_s: float) -> bool:
    """Whether everything that an outcome needs has happened."""
    kinds = {event.kind for event in flight}
    crossed_net = "net_plane" in kinds or hit.state[3] <= 0 or now_s > hit.t_s + MAX_FLIGHT_S
    return "floor" in kinds and crossed_net


def _record(i: int, hit: RallyEvent, flight: list[RallyEvent], outcomes: Outcomes) -> None:
    outcomes.hit_t_s[i] = hit.t_s
    outcomes.hit_states[i] = hit.state
    first = next(event for event in flight if event.kind in ("bounce", "net", "end", "floor"))
    outcomes.case[i] = Case.OUT if first.kind == "floor" else case_of(first)
    outcomes.contact_t_s[i] = first.t_s
    outcomes.contact_states[i] = first.touched
    landing = next((e for kind in ("down", "top") for e in flight if e.kind == kind), hit)
    outcomes.landing_t_s[i] = landing.t_s
    outcomes.landing_states[i] = landing.state
    at_net = next((event for event in flight if event.kind == "net_plane"), None)
    if at_net is not None and hit.state[3] > 0:
        outcomes.net_z_m[i] = at_net.state[2]
