"""A rally in MuJoCo, step by step: flight by its Runge-Kutta integrator, impacts by rigid impulses at their exact time.

Soft contacts are wrong at 10 ms steps and scatter landings by centimetres at 1 ms, because the phase of the step in the
contact decides the bounce. Here a step that would cross table, net, floor or racket is shortened to the instant of the
impact, the impulse is given to MuJoCo's velocities, and the rest of the step goes on: the step length changes nothing.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.physics import crossing
from core.physics.crossing import find_crossings, piece_at
from core.physics.impact import strike, surfaces_from_config
from core.physics.rotation import base_orientation, normals_from_orientations
from core.physics.task import TaskConfig
from core.simulation.episodes.episode_path import rebound_from_wall
from core.simulation.episodes.mujoco_model import build_model, mj
from core.simulation.episodes.racket import (
    RacketConfig,
    RacketState,
    RacketTarget,
    check_target,
    move_racket,
    upright_racket,
)
from core.simulation.episodes.rally_events import PASSAGES, RallyEvent, RallyEventKind, face_row, impact_kind
from core.table import BALL_RADIUS_M

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

MAX_IMPACTS_PER_STEP = 50
LIVELY_MPS = 0.05
"""A ball that leaves an impact with the table slower than this is at rest."""


class MujocoRally:
    """Table, ball and racket as MuJoCo bodies. Not for use by two threads at once."""

    def __init__(
        self, task: TaskConfig, racket: RacketConfig | None = None, *, dt_s: float = 0.01, ghost_after_hit: bool = False
    ) -> None:
        """With `ghost_after_hit` a struck ball flies on through table, net and floor, and only the events tell."""
        if not 1e-5 <= dt_s <= 0.05:
            raise ConfigError("no such time step", expected="0.00001 to 0.05 s", got=dt_s, where="MujocoRally")
        self.task = task
        self.racket_config = racket if racket is not None else RacketConfig()
        self.dt_s = dt_s
        self.model = build_model(task.physics, dt_s=dt_s)
        self.data = mj.MjData(self.model)
        self._ghost_after_hit = ghost_after_hit
        self._solid = True
        self._table, self._rubber = surfaces_from_config(task.physics)
        self._home_q = base_orientation(task.stroke)
        self._time_s = 0.0
        self._playing = False
        self._racket = upright_racket(self.racket_config)
        self._target: RacketTarget | None = None
        self._coasting = False
        self._times = np.empty(crossing.COUNT)

    @property
    def time_s(self) -> float:
        """Simulated time since the start."""
        return self._time_s

    @property
    def playing(self) -> bool:
        """Whether a ball is in the air: served, and not yet on the floor or at rest."""
        return self._playing

    @property
    def racket(self) -> RacketState:
        """Where the racket is now."""
        return self._racket

    @property
    def ball(self) -> Array:
        """(9,) position, velocity and spin of the ball in the world, now."""
        state = np.empty(9)
        state[:3] = self.data.qpos[:3]
        state[3:6] = self.data.qvel[:3]
        mj.mju_rotVecQuat(state[6:9], self.data.qvel[3:6], self.data.qpos[3:7])
        return state

    def serve(self, position_m: ArrayLike, velocity_mps: ArrayLike, spin_radps: ArrayLike = (0, 0, 0)) -> RallyEvent:
        """Put the ball into play now.

        Raises:
            ConfigError: if a number is not finite or the ball would start inside something or absurdly fast.
        """
        state = np.concatenate([np.asarray(a, np.float64).reshape(-1) for a in (position_m, velocity_mps, spin_radps)])
        if state.shape != (9,) or not np.isfinite(state).all():
            raise ConfigError("not a serve", expected="three finite (3,) vectors", got=state.tolist(), where="serve")
        if np.abs(state[:2]).max() > 5 or not BALL_RADIUS_M < state[2] < 3:
            raise ConfigError(
                "a serve starts above the table's plane, within 5 m", got=state[:3].tolist(), where="serve"
            )
        if np.linalg.norm(state[3:6]) > 40 or np.linalg.norm(state[6:9]) > 1500:
            raise ConfigError("no such ball", expected="up to 40 m/s and 1500 rad/s", where="serve")
        self.data.qpos[3:7] = (1, 0, 0, 0)
        self._write_ball(state)
        self._playing = self._solid = True
        return RallyEvent("serve", self._time_s, state, state)

    def aim_racket(self, target: RacketTarget | None) -> None:
        """Send the racket to a target, or with None back to rest.

        Raises:
            ConfigError: if the target is out of bounds.
        """
        self._target = None if target is None else check_target(target, self.racket_config)
        self._coasting = False

    def coast_racket(self, state: RacketState) -> None:
        """Put the racket somewhere at once, to go on with its velocity and no limits until it is aimed again."""
        self._racket = state
        self._coasting = True

    def reset(self) -> None:
        """Back to time zero: no ball, the racket at rest."""
        mj.mj_resetData(self.model, self.data)
        self._time_s, self._playing, self._target, self._coasting = 0.0, False, None, False
        self._solid = True
        self._racket = upright_racket(self.racket_config)

    def step(self, dt_s: float | None = None) -> tuple[RallyEvent, ...]:
        """Advance by `dt_s`, by default the rally's own step, and tell what happened, in order."""
        remaining = self.dt_s if dt_s is None else dt_s
        events: list[RallyEvent] = []
        impacts = 0
        while remaining > 1e-12:
            h = self._until_racket_switches(min(remaining, self.dt_s))
            advanced = self._advance(h, events)
            remaining -= advanced
            impacts = impacts + 1 if advanced < h else 0
            if impacts > MAX_IMPACTS_PER_STEP:
                logger.warning("ball stopped after %d impacts in one step", impacts)
                self._playing = False
        return tuple(events)

    def _until_racket_switches(self, h: float) -> float:
        """`h`, or less if the racket's law changes sooner: at the time of its target and after the follow-through.

        So a step never spans two laws, and the racket's path within it is one cubic.
        """
        if self._target is None or self._coasting:
            return h
        for t in (self._target.t_s, self._target.t_s + self.racket_config.follow_through_s):
            if self._time_s < t - 1e-12:
                return min(h, t - self._time_s)
        self._target = None
        return h

    def _advance(self, h: float, events: list[RallyEvent]) -> float:
        """Advance by `h` or to the next impact; returns the time advanced."""
        racket_end = self._racket_after(h)
        if not self._playing:
            return self._finish(h, racket_end)
        start, qpos, qvel = self.ball, self.data.qpos.copy(), self.data.qvel.copy()
        self._integrate(h)
        until, impact, passages = self._look_for_impact(start, self.ball, h, racket_end)
        events.extend(passages)
        if impact is None:
            return self._finish(h, racket_end)
        self.data.qpos[:], self.data.qvel[:] = qpos, qvel
        racket_then = self._racket_after(until)
        if until > 0:
            self._integrate(until)
        self._finish(until, racket_then)
        events.append(self._collide(impact))
        return until

    def _finish(self, h: float, racket: RacketState) -> float:
        """Let `h` be over for clock and racket; the ball is already there."""
        self._commit_racket(racket)
        self._time_s += h
        return h

    def _look_for_impact(
        self, start: Array, end: Array, h: float, racket_end: RacketState
    ) -> tuple[float, RallyEventKind | None, list[RallyEvent]]:
        """The first impact of a step from `start` to `end`, when it is, and the passages before it."""
        face_start, face_end = face_row(self._racket), face_row(racket_end)
        find_crossings(start, end, h, face_start, face_end, self.task.stroke.hit_plane_x_m, self._times)
        until, impact = h, None
        found: list[tuple[float, RallyEventKind, Array]] = []
        for which in np.flatnonzero(~np.isnan(self._times)):
            t = float(self._times[which])
            state = np.empty(9)
            piece_at(start, end, h, t, state)
            kind = impact_kind(int(which), state, face_start, face_end, t / h, self.task.physics.racket_radius_m)
            if kind is not None and not self._solid:
                found.append((t, kind, state))
            elif kind is not None and (impact is None or t < until):
                until, impact = t, kind
            if int(which) in PASSAGES and (kind is None or not self._solid):
                found.append((t, PASSAGES[int(which)], state))
        found.sort(key=lambda item: item[0])
        passages = [RallyEvent(kind, self._time_s + t, state, state) for t, kind, state in found if t <= until]
        return until, impact, passages

    def _racket_after(self, h: float) -> RacketState:
        now = self._racket
        if self._coasting:
            return RacketState(now.p_m + now.v_mps * h, now.v_mps, now.q_wxyz, np.zeros(3))
        return move_racket(now, self._target, self._time_s, h, self.racket_config, self._home_q)

    def _integrate(self, h: float) -> None:
        self.model.opt.timestep = h
        mj.mj_step(self.model, self.data)

    def _collide(self, kind: RallyEventKind) -> RallyEvent:
        """Give the ball the impulse of an impact at its present state."""
        before = self.ball
        after = before.copy()
        if kind == "bounce":
            strike(after, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), self._table)
            after[2] = BALL_RADIUS_M
            self._playing = bool(after[5] > LIVELY_MPS)
        elif kind == "hit":
            normal = normals_from_orientations(self._racket.q_wxyz)
            nx, ny, nz = map(float, normal)
            lever = before[:3] - BALL_RADIUS_M * normal - self._racket.p_m
            wall = self._racket.v_mps + np.cross(self._racket.turn_radps, lever)
            strike(after, (nx, ny, nz), (float(wall[0]), float(wall[1]), float(wall[2])), self._rubber)
            self._solid = not self._ghost_after_hit
        elif kind == "floor":
            after[3:9] = 0
            self._playing = False
        else:
            rebound_from_wall(after, self.task)
        self._write_ball(after)
        return RallyEvent(kind, self._time_s, after, before)

    def _write_ball(self, state: Array) -> None:
        """Put a world state into MuJoCo, whose angular velocity is in the body's frame."""
        self.data.qpos[:3] = state[:3]
        self.data.qvel[:3] = state[3:6]
        conjugate = self.data.qpos[3:7] * (1, -1, -1, -1)
        mj.mju_rotVecQuat(self.data.qvel[3:6], state[6:9], conjugate)

    def _commit_racket(self, state: RacketState) -> None:
        self._racket = state
        self.data.qpos[7:10] = state.p_m
        self.data.qpos[10:14] = state.q_wxyz
        self.data.qvel[6:9] = state.v_mps
        self.data.qvel[9:12] = 0
