"""The racket as a bounded actuator: it reaches a pose with a velocity at a time, as far as its limits allow.

Towards a target it follows the path of least squared acceleration, a cubic per axis, exactly; where that would break a
limit it does what the limit allows and so comes late or falls short, and the ball may miss it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.errors import ConfigError
from core.physics.rotation import axis_quaternion, multiply_quaternions, normals_from_orientations
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class RacketConfig:
    """Limits and resting place of the simulated racket (choices; of the order of the arms in published systems)."""

    max_speed_mps: float = setting(5.0, 0.5, 20.0)
    max_acceleration_mps2: float = setting(80.0, 5.0, 500.0)
    max_turn_rate_radps: float = setting(20.0, 1.0, 100.0)
    reach_m: float = setting(1.2, 0.1, 3.0)
    """Targets farther than this from the resting place are refused."""
    follow_through_s: float = setting(0.08, 0.0, 0.5)
    """How long the racket keeps its velocity after the time of the impact, for a ball that comes late."""
    settle_s: float = setting(0.4, 0.1, 2.0)
    """Time constant of the way back to rest."""
    home_x_m: float = setting(-1.60, -3.0, -1.0)
    home_y_m: float = setting(0.0, -1.0, 1.0)
    home_z_m: float = setting(0.25, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def home_m(self) -> Array:
        """The resting place (3,)."""
        return np.array([self.home_x_m, self.home_y_m, self.home_z_m])


@dataclass(frozen=True, slots=True, eq=False)
class RacketState:
    """Pose and motion of the racket's frame: origin in the middle of the face, x axis along its normal."""

    p_m: Array
    v_mps: Array
    q_wxyz: Array
    turn_radps: Array
    """(3,) angular velocity, world."""


@dataclass(frozen=True, slots=True, eq=False)
class RacketTarget:
    """Where the middle of the face is to be at a time, how it stands, and how fast it moves then."""

    p_m: Array
    q_wxyz: Array
    v_mps: Array
    t_s: float


def check_target(target: RacketTarget, config: RacketConfig) -> RacketTarget:
    """The target with a unit quaternion, if the racket may go there.

    Raises:
        ConfigError: if a number is not finite, a shape is wrong, or a limit is passed.
    """
    p, q, v = (np.asarray(a, np.float64) for a in (target.p_m, target.q_wxyz, target.v_mps))
    where = "racket target"
    if p.shape != (3,) or q.shape != (4,) or v.shape != (3,):
        raise ConfigError(
            "wrong shape", expected="(3,), (4,), (3,)", got=f"{p.shape}, {q.shape}, {v.shape}", where=where
        )
    if not (np.isfinite(p).all() and np.isfinite(q).all() and np.isfinite(v).all() and math.isfinite(target.t_s)):
        raise ConfigError("not finite", where=where)
    if abs(float(np.linalg.norm(q)) - 1) > 1e-3:
        raise ConfigError("not a unit quaternion", got=float(np.linalg.norm(q)), where=where)
    if float(np.linalg.norm(v)) > config.max_speed_mps:
        raise ConfigError("too fast", expected=f"at most {config.max_speed_mps:g} m/s", got=v.round(3), where=where)
    if float(np.linalg.norm(p - config.home_m)) > config.reach_m:
        raise ConfigError("out of reach", expected=f"{config.reach_m:g} m around rest", got=p.round(3), where=where)
    return RacketTarget(p, q / np.linalg.norm(q), v, float(target.t_s))


def move_racket(
    state: RacketState, target: RacketTarget | None, t_s: float, h: float, config: RacketConfig, home_q: Array
) -> RacketState:
    """The racket `h` seconds after `t_s`, on its way to the target, following through, or on its way back to rest.

    Args:
        state: the racket at `t_s`.
        target: where it goes; None: to rest.
        t_s: time of the state.
        h: duration, s.
        config: its largest speed, acceleration and turn rate.
        home_q: (4,) orientation at rest, wxyz.
    """
    # The law of motion changes at the impact: a step across it is made in two.
    if target is not None and t_s < target.t_s < t_s + h:
        at_target = move_racket(state, target, t_s, target.t_s - t_s, config, home_q)
        return move_racket(at_target, target, target.t_s, t_s + h - target.t_s, config, home_q)
    q, turn = _turn(state.q_wxyz, home_q if target is None else target.q_wxyz, h, config.max_turn_rate_radps)
    if target is not None and t_s >= target.t_s:
        return RacketState(state.p_m + state.v_mps * h, state.v_mps, q, turn)
    if target is None:
        left = config.settle_s
        goal, v_goal = config.home_m, np.zeros(3)
    else:
        left = target.t_s - t_s
        goal, v_goal = target.p_m, target.v_mps
    p, v = _push(state.p_m, state.v_mps, goal, v_goal, left, h, config)
    return RacketState(p, v, q, turn)


def _push(
    p: Array, v: Array, goal: Array, v_goal: Array, left: float, h: float, config: RacketConfig
) -> tuple[Array, Array]:
    """Position and velocity after `h` on the cubic that is at `goal` with `v_goal` after `left` >= h seconds."""
    a = 6 * (goal - p) / left**2 - (4 * v + 2 * v_goal) / left
    jerk = (-12 * (goal - p) / left + 6 * (v + v_goal)) / left**2
    v_end = v + a * h + jerk * h * h / 2
    hardest = max(_length(a), _length(a + jerk * h))
    if hardest <= config.max_acceleration_mps2 and _length(v_end) <= config.max_speed_mps:
        return p + v * h + a * h * h / 2 + jerk * h**3 / 6, v_end
    a = _limited(a + jerk * h / 2, config.max_acceleration_mps2)
    v_end = _limited(v + a * h, max(config.max_speed_mps, _length(v) - config.max_acceleration_mps2 * h))
    return p + (v + v_end) * h / 2, v_end


def _length(vector: Array) -> float:
    """What numpy's norm says, in a fifth of its time."""
    return math.sqrt(vector @ vector)


def _limited(vector: Array, length: float) -> Array:
    norm = _length(vector)
    return vector if norm <= length else vector * (length / norm)


def _turn(q: Array, goal: Array, h: float, max_rate: float) -> tuple[Array, Array]:
    """Orientation after turning towards `goal` for `h` seconds at `max_rate` or less, and the angular velocity."""
    conjugate = q * np.array([1.0, -1.0, -1.0, -1.0])
    rest = multiply_quaternions(goal, conjugate)
    if rest[0] < 0:
        rest = -rest
    sine = _length(rest[1:])
    if sine < 1e-12 or h <= 0:
        return q, np.zeros(3)
    angle = 2 * math.atan2(sine, float(rest[0]))
    axis = rest[1:] / sine
    step = min(angle, max_rate * h)
    if step == angle:
        return goal, axis * (step / h)
    turned = multiply_quaternions(np.concatenate([[math.cos(step / 2)], axis * math.sin(step / 2)]), q)
    return turned / _length(turned), axis * (step / h)


def upright_racket(config: RacketConfig) -> RacketState:
    """The racket at rest with its face along +x."""
    return RacketState(config.home_m, np.zeros(3), axis_quaternion(0, 0.0), np.zeros(3))


def target_for_ball(ball_p_m: Array, q_wxyz: Array, v_mps: Array, t_s: float) -> RacketTarget:
    """The target whose face touches, in its middle, a ball with its centre at `ball_p_m` at `t_s`.

    Args:
        ball_p_m: (3,) centre of the ball, world.
        q_wxyz: (4,) orientation of the racket.
        v_mps: (3,) its velocity.
        t_s: when.
    """
    return RacketTarget(ball_p_m - BALL_RADIUS_M * normals_from_orientations(q_wxyz), q_wxyz, v_mps, t_s)
