"""A rally in MuJoCo, step by step: flight by its Runge-Kutta integrator, impacts by rigid impulses at their exact time.

Soft contacts are wrong at 10 ms steps and scatter landings by centimetres at 1 ms, because the phase of the step in the
contact decides the bounce. Here a step that would cross table, net, floor or racket is shortened to the instant of the
impact, the impulse is given to MuJoCo's velocities, and the rest of the step goes on: the step length changes nothing.
"""

from __future__ import annotations

import logging
import math
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.physics import crossing
from core.physics.config import PhysicsConfig
from core.physics.crossing import find_crossings, piece_at
from core.physics.episode import Case, Outcomes, Serves, Strokes
from core.physics.flight import MAX_FLIGHT_S
from core.physics.impact import strike, surfaces_from_config
from core.physics.rotation import base_orientation, normals_from_orientations
from core.physics.task import TaskConfig
from core.simulation.episodes.ball_outcome import PASSAGES, RallyEvent, RallyEventKind, case_of, face_row, impact_kind
from core.simulation.episodes.closed_form import fly_serves
from core.simulation.episodes.episode_path import rebound_from_wall
from core.simulation.episodes.racket import (
    RacketConfig,
    RacketState,
    RacketTarget,
    check_target,
    move_racket,
    upright_racket,
)
from core.table import (
    BALL_MASS_KG,
    BALL_RADIUS_M,
    GRAVITY_MPS2,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)

logger = logging.getLogger(__name__)


mj: Final[Any] = mujoco
"""The compiled module comes without type stubs: its names are untyped, here and in the files that step the model."""
BALL_INERTIA_KGM2 = 2 / 3 * BALL_MASS_KG * BALL_RADIUS_M**2
RACKET_MASS_KG = 50.0
"""So heavy that the ball does not slow it: 5e-5 of the momentum."""
_SPHERE_ADDED_MASS = 0.5
"""Added mass as a share of the displaced air. MuJoCo's ellipsoid fluid model subtracts this much from the Magnus
coefficient of a sphere."""


def build_model(physics: PhysicsConfig, *, dt_s: float) -> Any:
    """The compiled model: free bodies `ball` (qpos 0:7, qvel 0:6) and `racket` (qpos 7:14, qvel 6:12)."""
    return mj.MjModel.from_xml_string(model_xml(physics, dt_s=dt_s))


def model_xml(physics: PhysicsConfig, *, dt_s: float) -> str:
    """The model's XML; the world frame is the table's (origin in the middle of the top)."""
    half_l, half_w = TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2
    top = 0.1  # half the thickness of the table's body
    post_y = half_w + NET_OVERHANG_M
    air = physics.air
    density = air.density_kg_per_m3 if physics.has_air else 0.0
    drag = air.drag_coefficient / 2  # MuJoCo's drag is C rho A v^2, without the usual half
    magnus = air.magnus_coefficient + _SPHERE_ADDED_MASS
    inertia = " ".join([str(BALL_INERTIA_KGM2)] * 3)
    deep = physics.racket_thickness_m / 2
    return f"""
<mujoco model="table tennis">
  <option timestep="{dt_s}" gravity="0 0 {-GRAVITY_MPS2}" density="{density}" viscosity="0" integrator="RK4"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" pos="0 0 {-TABLE_HEIGHT_M}" size="6 4 0.1" rgba="0.2 0.2 0.22 1"/>
    <geom name="table" type="box" pos="0 0 {-top}" size="{half_l} {half_w} {top}" rgba="0.1 0.3 0.6 1"/>
    <geom name="net" type="box" pos="0 0 {NET_HEIGHT_M / 2}" size="0.002 {post_y} {NET_HEIGHT_M / 2}" rgba="1 1 1 0.5"/>
    <geom name="post_left" type="cylinder" pos="0 {post_y} {NET_HEIGHT_M / 2}" size="0.01 {NET_HEIGHT_M / 2}"/>
    <geom name="post_right" type="cylinder" pos="0 {-post_y} {NET_HEIGHT_M / 2}" size="0.01 {NET_HEIGHT_M / 2}"/>
    <body name="ball" pos="0 0 1">
      <freejoint/>
      <inertial pos="0 0 0" mass="{BALL_MASS_KG}" diaginertia="{inertia}"/>
      <geom name="ball" type="sphere" size="{BALL_RADIUS_M}" rgba="1 0.6 0.1 1" fluidshape="ellipsoid"
            fluidcoef="{drag} {drag} 0 0 {magnus}"/>
    </body>
    <body name="racket" pos="-1.6 0 0.25" gravcomp="1">
      <freejoint/>
      <inertial pos="0 0 0" mass="{RACKET_MASS_KG}" diaginertia="50 50 50"/>
      <geom name="racket" type="cylinder" pos="{-deep} 0 0" zaxis="1 0 0" size="{physics.racket_radius_m} {deep}"
            rgba="0.8 0.1 0.1 1" fluidshape="ellipsoid" fluidcoef="0 0 0 0 0"/>
    </body>
  </worldbody>
</mujoco>"""


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


def simulate_episodes_mujoco(serves: Serves, strokes: Strokes, config: TaskConfig, *, dt_s: float = 0.01) -> Outcomes:
    """What `simulate_episodes` gives, stepped in MuJoCo with event-driven impacts.

    The racket coasts with the stroke's velocity, without limits. After the stroke the ball flies on through table and
    net, so that landing and height at the net are read off the same flight.

    Args:
        serves: N launches.
        strokes: N rackets' orientations and velocities, and where they aim.
        config: the task.
        dt_s: step of MuJoCo.
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
