"""The one-step task for many episodes at once: serve -> bounce -> hitting plane, racket -> flight -> outcome; and
seeded serves of a launcher on the opponent's side.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.jit import njit
from core.physics import contact
from core.physics.contact import come_down, cross_net_plane, highest_point, next_contact
from core.physics.episode import CASE_OF_CONTACT, Arrivals, Case, Outcomes, Serves, Strokes, TimedStates
from core.physics.flight import Air, air_from_config, fall_through, fly
from core.physics.impact import Surface, strike, surfaces_from_config
from core.physics.rotation import normals_from_orientations
from core.physics.task import TaskConfig
from core.table import BALL_RADIUS_M, GRAVITY_MPS2

Array = NDArray[np.float64]

MISSED = int(Case.MISSED)
_UP = (0.0, 0.0, 1.0)
_STILL = (0.0, 0.0, 0.0)


def fly_serves(serves: Serves, config: TaskConfig) -> Arrivals:
    """Every serve up to the hitting plane."""
    n = len(serves)
    legal, bounces, arrivals = np.zeros(n, np.bool_), TimedStates.unknown(n), TimedStates.unknown(n)
    table, _ = surfaces_from_config(config.physics)
    air = air_from_config(config.physics)
    states = np.ascontiguousarray(serves.states())
    _fly_serves(states, config.stroke.hit_plane_x_m, air, table, legal, bounces, arrivals)
    return Arrivals(legal, *bounces, *arrivals)


def return_balls(arrivals: Arrivals, strokes: Strokes, config: TaskConfig) -> Outcomes:
    """What comes of one stroke per arriving ball.

    Raises:
        ConfigError: if there is not exactly one stroke per arrival.
    """
    n = len(arrivals.t_s)
    if strokes.qs_wxyz.shape != (n, 4) or strokes.vs_mps.shape != (n, 3):
        raise ConfigError(
            "not one stroke per ball", expected=f"({n}, 4) and ({n}, 3)", got=strokes.qs_wxyz.shape, where="Strokes"
        )
    hits = TimedStates.unknown(n)
    _, rubber = surfaces_from_config(config.physics)
    normals = np.ascontiguousarray(normals_from_orientations(strokes.qs_wxyz))
    rackets = np.ascontiguousarray(strokes.vs_mps, np.float64)
    if strokes.aim_ps_m is None or strokes.aim_t_s is None:
        _meet_in_plane(TimedStates(arrivals.t_s, arrivals.states), normals, rackets, rubber, hits)
    else:
        aims = np.ascontiguousarray(np.column_stack([strokes.aim_ps_m, strokes.aim_t_s]))
        radius, air = config.physics.racket_radius_m, air_from_config(config.physics)
        starts = TimedStates(arrivals.bounce_t_s, arrivals.bounce_states)
        _meet_at_aim(starts, normals, rackets, aims, radius, air, rubber, hits)
    return follow_hits(hits.t_s, hits.states, config)


def follow_hits(hit_t_s: Array, hit_states: Array, config: TaskConfig) -> Outcomes:
    """What comes of balls that left the racket at `hit_t_s` (N,) with `hit_states` (N, 9); NaN is a miss."""
    n = len(hit_t_s)
    case, net_z = np.full(n, MISSED, np.int8), np.full(n, np.nan)
    hits, landings, contacts = TimedStates(hit_t_s, hit_states), TimedStates.unknown(n), TimedStates.unknown(n)
    _follow(hits, air_from_config(config.physics), case, landings, net_z, contacts)
    return Outcomes(case, hit_t_s, hit_states, *landings, net_z, *contacts)


def simulate_episodes(serves: Serves, strokes: Strokes, config: TaskConfig) -> Outcomes:
    """Whole episodes; use `fly_serves` and `return_balls` where a decision lies between."""
    return return_balls(fly_serves(serves, config), strokes, config)


def sample_serves(serves: Serves, arrivals: Arrivals, t_s: Array, config: TaskConfig) -> Array:
    """Positions (N, K, 3) of the balls at times (N, K) from launch until the racket: what a perception sees.

    Only legal serves have one bounce; others give the flight before and after their last one.

    Args:
        serves: N launches.
        arrivals: of the same balls.
        t_s: (N, K) times from the launch.
        config: the physics.
    """
    positions = np.empty((*t_s.shape, 3))
    _sample(
        np.ascontiguousarray(serves.states()),
        arrivals.bounce_t_s,
        arrivals.bounce_states,
        np.ascontiguousarray(t_s, np.float64),
        air_from_config(config.physics),
        positions,
    )
    return positions


@njit
def _fly_serves(
    serves: Array,
    hit_x: float,
    air: Air,
    table: Surface,
    legal: NDArray[np.bool_],
    bounces: TimedStates,
    arrivals: TimedStates,
) -> None:
    touched_state = np.empty(9)
    at_plane = np.empty(9)
    s = np.empty(9)
    for i in range(len(serves)):
        s[:] = serves[i]
        t = 0.0
        count = 0
        on_own_half = True
        while count < 8:
            what, dt = next_contact(s, air, touched_state)
            dt_plane = fall_through(s, (1.0, 0.0, 0.0, 0.0, -hit_x), air, at_plane)
            if not math.isnan(dt_plane) and dt_plane <= dt:
                arrivals.t_s[i] = t + dt_plane
                arrivals.states[i] = at_plane
                legal[i] = serves[i, 0] > 0 and count == 1 and on_own_half
                break
            if what not in (contact.OWN_TOP, contact.FAR_TOP):
                break
            t += dt
            count += 1
            on_own_half = on_own_half and what == contact.OWN_TOP
            s[:] = touched_state
            strike(s, _UP, _STILL, table)
            # Exactly on the table: a rounding error below it would be another contact at once.
            s[2] = BALL_RADIUS_M
            bounces.t_s[i] = t
            bounces.states[i] = s


@njit
def _meet_in_plane(arrivals: TimedStates, normals: Array, rackets: Array, rubber: Surface, hits: TimedStates) -> None:
    for i in range(len(arrivals.t_s)):
        s = hits.states[i]
        s[:] = arrivals.states[i]
        n, v = normals[i], rackets[i]
        towards = (s[3] - v[0]) * n[0] + (s[4] - v[1]) * n[1] + (s[5] - v[2]) * n[2]
        # `not <` so that a NaN (a serve that did not arrive) and a ball that cannot catch the racket are misses.
        if not towards < 0:
            s[:] = math.nan
            continue
        strike(s, (n[0], n[1], n[2]), (v[0], v[1], v[2]), rubber)
        hits.t_s[i] = arrivals.t_s[i]


@njit
def _meet_at_aim(
    starts: TimedStates,
    normals: Array,
    rackets: Array,
    aims: Array,
    radius: float,
    air: Air,
    rubber: Surface,
    hits: TimedStates,
) -> None:
    s, start_t = np.empty(9), starts.t_s
    for i in range(len(start_t)):
        if math.isnan(start_t[i]):
            continue
        n, v, aim = normals[i], rackets[i], aims[i]
        # The centre of a ball that the middle of the face touches, when the ball leaves the table.
        lead = start_t[i] - aim[3]
        cx, cy, cz = aim[0] + v[0] * lead, aim[1] + v[1] * lead, aim[2] + v[2] * lead
        plane = (
            n[0],
            n[1],
            n[2],
            -(n[0] * v[0] + n[1] * v[1] + n[2] * v[2]),
            -(n[0] * cx + n[1] * cy + n[2] * cz),
        )
        t = fall_through(starts.states[i], plane, air, s)
        if math.isnan(t):
            continue
        dx, dy, dz = s[0] - cx - v[0] * t, s[1] - cy - v[1] * t, s[2] - cz - v[2] * t
        if dx * dx + dy * dy + dz * dz > radius * radius or s[2] < contact.FLOOR_Z_M + BALL_RADIUS_M:
            continue
        strike(s, (n[0], n[1], n[2]), (v[0], v[1], v[2]), rubber)
        hits.states[i] = s
        hits.t_s[i] = start_t[i] + t


@njit
def _follow(
    hits: TimedStates,
    air: Air,
    case: NDArray[np.int8],
    landings: TimedStates,
    net_z: Array,
    contacts: TimedStates,
) -> None:
    at_net, hit_t = np.empty(9), hits.t_s
    for i in range(len(hit_t)):
        if math.isnan(hit_t[i]):
            continue
        s = hits.states[i]
        t = come_down(s, air, landings.states[i])
        if math.isnan(t):
            t = highest_point(s, air, landings.states[i])
        landings.t_s[i] = hit_t[i] + t
        if s[0] < 0 and s[3] > 0 and not math.isnan(cross_net_plane(s, air, at_net)):
            net_z[i] = at_net[2]
        what, t = next_contact(s, air, contacts.states[i])
        case[i] = CASE_OF_CONTACT[what]
        contacts.t_s[i] = hit_t[i] + t


@njit
def _sample(serves: Array, bounce_t: Array, bounce_states: Array, t_s: Array, air: Air, positions: Array) -> None:
    s = np.empty(9)
    for i in range(len(serves)):
        now = math.inf
        bounced = False
        for k in range(t_s.shape[1]):
            t = t_s[i, k]
            after = t >= bounce_t[i]
            if t < now or after != bounced:
                bounced = after
                now = bounce_t[i] if after else 0.0
                s[:] = bounce_states[i] if after else serves[i]
            while air.acts and t - now > air.step_s:
                fly(s, air.step_s, air, s)
                now += air.step_s
            fly(s, t - now, air, s)
            now = t
            positions[i, k] = s[:3]


MAX_ROUNDS = 200
"""Most rounds of drawing again; a distribution without a legal serve by then has practically none."""


def draw_serves(speed_mps: float, count: int, config: TaskConfig, rng: np.random.Generator) -> Serves:
    """`count` serves of one speed, 3 to 9 m/s.

    Args:
        speed_mps: of the ball at the launcher.
        count: number of serves.
        config: where the launcher is, how serves spread, and the physics.
        rng: source of random numbers.

    Raises:
        ConfigError: if the speed is out of range, or the distribution has (nearly) no legal serve.
    """
    if not 3.0 <= speed_mps <= 9.0:
        raise ConfigError("no serve of this speed", expected="3 to 9 m/s", got=speed_mps, where="draw_serves")
    if not config.serve.only_legal:
        return _draw(speed_mps, count, config, rng)
    found: list[Serves] = []
    missing = count
    for _ in range(MAX_ROUNDS):
        if missing <= 0:
            break
        # In batches, a serve at a time would be slow: more than are missing, as some are not legal.
        drawn = _draw(speed_mps, max(16, 2 * missing), config, rng)
        legal = drawn[fly_serves(drawn, config).legal][:missing]
        found.append(legal)
        missing -= len(legal)
    if missing > 0:
        raise ConfigError(
            "the serve distribution has no legal serves",
            got=f"{count - missing} of {count} after {MAX_ROUNDS} rounds at {speed_mps:g} m/s",
            remedy="change the elevation, the height or the bounce position, or set only_legal to false",
        )
    return Serves(
        *(np.concatenate(parts) for parts in zip(*((s.ps_m, s.vs_mps, s.spins_radps) for s in found), strict=True))
    )


def _draw(speed_mps: float, count: int, config: TaskConfig, rng: np.random.Generator) -> Serves:
    serve = config.serve
    z = rng.uniform(serve.height_low_m, serve.height_high_m, count)
    y = rng.uniform(-1, 1, count) * serve.lateral_spread_m
    shift = rng.uniform(-1, 1, count) * serve.bounce_spread_m
    y_hit = rng.uniform(-1, 1, count) * serve.lateral_spread_m if serve.aim_lateral else y
    elevation = serve.elevation.at(speed_mps) + math.radians(serve.elevation_spread_deg) * rng.uniform(-1, 1, count)
    speed = speed_mps * (1 + serve.speed_spread * rng.uniform(-1, 1, count))
    spin = serve.spin_spread_radps * rng.uniform(-1, 1, (count, 3))
    x = serve.bounce_x_m + _flight_distance(speed_mps, config) + shift
    yaw = np.arctan2(y_hit - y, x - config.stroke.hit_plane_x_m)
    velocity = speed[:, None] * np.column_stack(
        [-np.cos(elevation) * np.cos(yaw), np.cos(elevation) * np.sin(yaw), np.sin(elevation)]
    )
    return Serves(np.column_stack([x, y, z]), velocity, spin)


def _flight_distance(speed_mps: float, config: TaskConfig) -> float:
    """How far the mean serve flies along x until it bounces, by gravity alone."""
    elevation = config.serve.elevation.at(speed_mps)
    drop = (config.serve.height_low_m + config.serve.height_high_m) / 2 - BALL_RADIUS_M
    vz = speed_mps * math.sin(elevation)
    return speed_mps * math.cos(elevation) * (vz + math.sqrt(vz * vz + 2 * GRAVITY_MPS2 * drop)) / GRAVITY_MPS2
