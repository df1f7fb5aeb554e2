"""The built-in controller: from a predicted ball to a racket pose and velocity, by inverting impact and flight.

What a controller decides on a predicted ball is the value that the player, the recording and the app share.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.chain.control.hit_choice import Stroke
from core.chain.control.return_chance import return_chance
from core.chain.control.stroke_solver import (
    SPEED,
    TILT,
    TURN,
    StrokeProblem,
    StrokeSolution,
    is_as_wanted,
    is_safe,
    search_stroke,
    solve_stroke,
    spin_after_bounce,
)
from core.config import check_settings, setting
from core.physics import PhysicsConfig, TaskConfig
from core.physics.flight import air_from_config
from core.physics.impact import surfaces_from_config
from core.physics.rotation import base_orientation, orientations_from_actions
from core.simulation.episodes.racket import RacketTarget, target_for_ball
from core.table import BALL_RADIUS_M, NET_HEIGHT_M
from core.trajectory.prediction import HitPlane, Stage

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RacketDecision:
    """Where the racket is sent, what for, and what is expected to come of it."""

    t_us: int = 0
    """End of the window that led to it; 0 from a controller, which knows of no windows."""
    stage: Stage
    """Stage of the prediction it answers."""
    state: Array
    """(6,) predicted p_c and v_c at the hitting plane; NaN where a recording does not say."""
    goal_m: Array
    """(2,) wanted landing point."""
    target: RacketTarget
    action: Array
    """(3,) in [-1, 1]: the orientation as q = q_base qx qy qz, in units of the action limit."""
    landing_m: Array | None = None
    """(2,) expected landing point; None before the orientation is decided, or where nobody computes it."""
    net_z_m: float | None = None
    """Expected height of the ball's centre over the net."""


SPIN_ROUNDS: Final = 2
"""The Magnus force on the way back to the bounce depends on the spin that is wanted."""
STEP_S: Final = 0.02
"""Integration step of the flight with air: four times the simulation's own step, 0.1 mm at the landing, and within the
time."""
START_TILT_RAD: Final = -0.07
"""Tilt of the face from which the solver starts: 4 degrees up, which returns most balls."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerConfig:
    """Where the built-in controller sends the ball, and what its strokes may be."""

    target_x_m: float = setting(0.80, 0.1, 1.37)
    """Landing point on the opponent's half (choice: a little behind its middle)."""
    target_y_m: float = setting(0.0, -0.76, 0.76)
    net_clearance_m: float = setting(0.15, 0.0, 0.6)
    """Wanted gap between the net and the ball (choice: room for errors; much more gives a slow, high ball)."""
    slowest_mps: float = setting(-2.5, -5.0, 3.0)
    """Lowest racket speed along +x at the impact; below zero the racket gives way, as fast balls demand."""
    fastest_mps: float = setting(4.5, 0.0, 5.0)
    """Highest racket speed; the simulated racket's own limit is 5."""
    lead_ms: float = setting(0.0, 0.0, 200.0)
    """The racket is told to be there so much before the ball: what a command takes to become motion, which a step test
    tells (`step_test`)."""
    orient_early: bool = False
    """Turn the face on the first prediction already. Off: the paper's, which decides the orientation after the
    bounce only and until then just moves there."""

    def __post_init__(self) -> None:
        check_settings(self)


class Controller(Protocol):
    """Answers a predicted ball with a decision: the built-in one, or a learned policy."""

    def decide(
        self,
        t_c_s: float,
        p_c_m: ArrayLike,
        v_c_mps: ArrayLike,
        *,
        stage: Stage,
        spin_radps: ArrayLike | None = None,
        spin_sigma_radps: ArrayLike | None = None,
    ) -> RacketDecision | None:
        """Where the racket goes for a ball that comes to the hitting plane at p_c with v_c at t_c; None: nowhere.

        With the ball's spin there, if it is known, and the standard deviations of that.

        Args:
            t_c_s: when the ball is at the hitting plane, s on the chain's clock.
            p_c_m: (3,) where, m, world.
            v_c_mps: (3,) its velocity there, m/s, world.
            stage: "pre" or "post": before or after the bounce.
            spin_radps: (3,) its spin there, rad/s, world; None: not known.
            spin_sigma_radps: (3,) standard deviations of the spin.
        """
        ...


class LiveController(Controller, Protocol):
    """One that can be chosen, and aimed elsewhere, while a rally goes on."""

    @property
    def name(self) -> str:
        """For people."""
        ...

    @property
    def goal_m(self) -> Array:
        """(2,) where balls are to land."""
        ...

    def aimed_at(self, goal_m: ArrayLike) -> LiveController:
        """A controller with another landing point (2,), m.

        Raises:
            ConfigError: if it cannot aim there.
        """
        ...

    def for_physics(self, physics: PhysicsConfig) -> LiveController:
        """A controller for other physics; a trained one is returned unchanged."""
        ...


class BuiltInController:
    """Moves early on the first prediction and corrects on the second. Holds no state: an answer per prediction."""

    def __init__(self, task: TaskConfig | None = None, config: ControllerConfig | None = None) -> None:
        self.task = task or TaskConfig()
        self.config = config or ControllerConfig()
        self._air = air_from_config(self.task.physics)._replace(step_s=STEP_S)
        self._table, self._rubber = surfaces_from_config(self.task.physics)
        self._limit = math.radians(self.task.stroke.action_limit_deg)

    @property
    def name(self) -> str:
        """What it is called among the controllers."""
        return "built-in"

    @property
    def goal_m(self) -> Array:
        """(2,) the configured landing point."""
        return np.array([self.config.target_x_m, self.config.target_y_m])

    def aimed_at(self, goal_m: ArrayLike) -> BuiltInController:
        """A controller with another landing point (2,), m.

        Raises:
            ConfigError: if it is beyond the bounds of the configuration.
        """
        x, y = (float(value) for value in np.asarray(goal_m, np.float64))
        return BuiltInController(self.task, replace(self.config, target_x_m=x, target_y_m=y))

    def for_physics(self, physics: PhysicsConfig) -> BuiltInController:
        """A controller for other physics."""
        return BuiltInController(replace(self.task, physics=physics), self.config)

    def decide(
        self,
        t_c_s: float,
        p_c_m: ArrayLike,
        v_c_mps: ArrayLike,
        *,
        stage: Stage,
        target_m: ArrayLike | None = None,
        spin_radps: ArrayLike | None = None,
        spin_sigma_radps: ArrayLike | None = None,
    ) -> RacketDecision | None:
        """The decision for a ball at the hitting plane, or None for one that no stroke can answer.

        Without a spin the ball is taken to carry what the table gives a spinless serve; how sure it is makes no
        difference. `target_m` (2,) replaces the configured landing point.

        Args:
            t_c_s: when the ball is at the hitting plane, s.
            p_c_m: (3,) where, m, world.
            v_c_mps: (3,) its velocity there, m/s, world.
            stage: "pre" or "post": before or after the bounce.
            target_m: (2,) x, y of the wanted landing, m.
            spin_radps: (3,) spin there, rad/s, world.
            spin_sigma_radps: not used.
        """
        p, v = np.asarray(p_c_m, np.float64), np.asarray(v_c_mps, np.float64)
        if not (math.isfinite(t_c_s) and np.isfinite(p).all() and np.isfinite(v).all() and v[0] < 0):
            return None
        goal = self.goal_m if target_m is None else np.asarray(target_m, np.float64)
        stroke = self.solve(self.ball_at(p, v, spin_radps), goal)
        if stroke is None:
            return None
        v_racket, landing, net_z_m = np.array([stroke.speed_mps, 0.0, 0.0]), None, None
        q, action = base_orientation(self.task.stroke), np.zeros(3)
        if stage == "post" or self.config.orient_early:
            # A turn about the face's own normal changes no stroke.
            action = np.array([0.0, stroke.tilt_rad, stroke.turn_rad]) / self._limit
            q = orientations_from_actions(action, self.task.stroke)
            landing, net_z_m = np.array([stroke.landing_x_m, stroke.landing_y_m]), stroke.net_z_m
        return RacketDecision(
            stage=stage,
            state=np.concatenate([p, v]),
            goal_m=goal,
            target=target_for_ball(p, q, v_racket, t_c_s - 1e-3 * self.config.lead_ms),
            action=action,
            landing_m=landing,
            net_z_m=net_z_m,
        )

    def ball_at(self, p_m: Array, v_mps: Array, spin_radps: ArrayLike | None) -> Array:
        """(9,) state of a ball; without a spin it carries what the table gives a spinless serve."""
        ball = np.concatenate([p_m, v_mps, np.zeros(3) if spin_radps is None else np.asarray(spin_radps, np.float64)])
        if spin_radps is None:
            # Without air the spin does not bend the way back to the bounce, and one round is exact.
            for _ in range(SPIN_ROUNDS if self._air.acts else 1):
                ball[6:] = spin_after_bounce(ball, self._table, self._air)
        return ball

    def solve(self, ball: Array, target_m: ArrayLike) -> StrokeSolution | None:
        """The stroke that sends a ball state (9,) to a landing point (2,) as nearly as the limits allow.

        Angles are those of the action, relative to the base orientation. None if no stroke brings it over the net
        plane and down again.
        """
        x, reached = np.empty(3), np.empty(3)
        spent = self.solve_problem(self.problem(ball, target_m), x, reached)
        if not spent:
            return None
        base = math.radians(self.task.stroke.base_pitch_deg)
        return StrokeSolution(x[TILT] + base, x[TURN], x[SPEED], reached[0], reached[1], reached[2], spent)

    def solve_problem(self, problem: StrokeProblem, x: Array, reached: Array) -> int:
        """Write the stroke (3,) to `x` and what it reaches (3,) to `reached`; evaluations it took, 0 if none plays."""
        start = np.clip(np.array([START_TILT_RAD, 0.0, _first_speed(problem.ball)]), problem.low, problem.high)
        spent = solve_stroke(problem, start, x, reached)
        if not spent or not is_as_wanted(reached, problem.wanted):
            spent += search_stroke(problem, x, reached)
        return 0 if math.isnan(x[0]) else spent

    def strokes(self) -> StrokeSearch:
        """How it would hit a ball at several places, for the choice of one."""
        return StrokeSearch(self)

    def problem(self, ball: Array, target_m: ArrayLike) -> StrokeProblem:
        """What is asked of a stroke: a ball state (9,), a landing point (2,), the bounds, rubber and air."""
        base = math.radians(self.task.stroke.base_pitch_deg)
        low = np.array([-self._limit - base, -self._limit, self.config.slowest_mps])
        high = np.array([self._limit - base, self._limit, self.config.fastest_mps])
        goal = np.asarray(target_m, np.float64)
        wanted = np.array([goal[0], goal[1], NET_HEIGHT_M + BALL_RADIUS_M + self.config.net_clearance_m])
        return StrokeProblem(ball, wanted, low, high, self._rubber, self._air)


class StrokeSearch:
    """Strokes for one ball at neighbouring places, each from the stroke before: a tenth of the time of a search."""

    def __init__(self, controller: BuiltInController) -> None:
        self._controller = controller
        self._near: Array | None = None

    def stroke_at(self, hit: HitPlane, covariance: Array) -> Stroke | None:
        """The stroke towards the controller's goal and its chance; (6, 6) how well the ball will be known."""
        if not hit.v_world_mps[0] < 0:
            return None
        controller = self._controller
        ball = controller.ball_at(hit.p_world_m, hit.v_world_mps, hit.spin_radps)
        problem, x, reached = controller.problem(ball, controller.goal_m), np.empty(3), np.empty(3)
        warm = self._near is not None and solve_stroke(problem, self._near, x, reached) > 0 and is_safe(reached)
        if not warm and not controller.solve_problem(problem, x, reached):
            return None
        self._near = x
        spread = np.zeros((9, 9))
        spread[:6, :6] = covariance
        if hit.spin_sigma_radps is not None:
            spread[6:, 6:] = np.diag(hit.spin_sigma_radps**2)
        chance, sigma_m = return_chance(problem, x, reached, spread, controller.task.physics.racket_radius_m)
        tilt, turn, speed = x.tolist()
        normal = np.array([math.cos(turn) * math.cos(tilt), math.sin(turn), -math.cos(turn) * math.sin(tilt)])
        return Stroke(hit.p_world_m - BALL_RADIUS_M * normal, np.array([speed, 0.0, 0.0]), chance, sigma_m, normal)


def _first_speed(ball: Array) -> float:
    """A racket speed that sends the ball back at about 4.5 m/s with a restitution of 0.8."""
    return (4.5 + 0.8 * float(ball[3])) / 1.8
