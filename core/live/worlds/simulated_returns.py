"""Balls whose states are known, played by the simulated robot: what its arm and its strokes can do, perception apart.

The controller is told at the launch, exactly, when, where and with which velocity and spin the ball will cross the
hitting plane; the racket then goes there within its limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.control.controller import BuiltInController, ControllerConfig
from core.chain.control.decision import RacketDecision
from core.config import check_settings, setting
from core.errors import ConfigError
from core.physics.contact import HALF_LENGTH_M, HALF_WIDTH_M
from core.physics.episode import Case, Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.ball_outcome import BallOutcome, RallyClassifier
from core.simulation.episodes.incoming import Incoming, fly_incoming
from core.simulation.episodes.mujoco_rally import MujocoRally
from core.simulation.episodes.racket import RacketConfig

Array = NDArray[np.float64]

AS_MEANT_M: Final = 0.05
"""A struck ball that comes down farther from where the stroke should have sent it was not struck as it should."""
LONGEST_S: Final = 6.0
"""From the launch to the verdict; no ball takes so long."""


class ReturnOutcome(IntEnum):
    """Outcome of a ball."""

    RETURNED = 0
    NOT_PLAYABLE = 1
    """The opponent's mistake, or no ball for a robot that waits behind the table: see `Incoming`."""
    NO_STROKE = 2
    """No stroke within the controller's bounds brings it over the net and down."""
    OUT_OF_REACH = 3
    """Farther from the home position than the racket can go."""
    NO_TIME = 4
    """The racket started as soon as the controller knew the ball, but missed it or hit it wrongly."""
    OWN_HALF = 5
    NET = 6
    LONG = 7
    WIDE = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedReturnsConfig:
    """Settings of the simulated returns."""

    task: TaskConfig = field(default_factory=TaskConfig)
    racket: RacketConfig = field(default_factory=RacketConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    told_after_ms: float = setting(0.0, 0.0, 1000.0)
    """Time after the launch at which the controller gets the ball's state; 0 is ideal."""
    step_ms: float = setting(10.0, 0.5, 20.0)
    """Step of the simulation; the racket's limits act from step to step (choice: with 2 ms, 1,200 balls had the same
    fates)."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedReturns:
    """Outcomes of N balls."""

    fate: NDArray[np.int8]
    """(N,) values of `ReturnOutcome`."""
    incoming: NDArray[np.int8]
    """(N,) values of `Incoming`."""
    is_service: NDArray[np.bool_]
    """(N,) whether it bounces on the opponent's half first."""
    error_m: Array
    """(N,) from the target to where a returned ball landed; NaN for others."""

    def count(self, fate: ReturnOutcome) -> int:
        """Number of balls with this outcome."""
        return int(np.count_nonzero(self.fate == fate))


def play_recorded_states(
    balls: Serves, config: SimulatedReturnsConfig, progress: Callable[[float], None] = lambda share: None
) -> SimulatedReturns:
    """Play each ball alone, from its launch to its outcome."""
    found = fly_incoming(balls, config.task)
    fate = np.full(len(balls), ReturnOutcome.NOT_PLAYABLE, np.int8)
    error_m = np.full(len(balls), np.nan)
    controller = BuiltInController(config.task, config.controller)
    rally = MujocoRally(config.task, config.racket, dt_s=1e-3 * config.step_ms)
    judge = RallyClassifier(config.task)
    for i in np.flatnonzero(found.incoming == Incoming.PLAYABLE):
        arrival = found.arrivals.states[i]
        decision = controller.decide(
            found.arrivals.t_s[i], arrival[:3], arrival[3:6], stage="post", spin_radps=arrival[6:]
        )
        if decision is None:
            fate[i] = ReturnOutcome.NO_STROKE
            continue
        rally.reset()
        serve = rally.serve(balls.ps_m[i], balls.vs_mps[i], balls.spins_radps[i])
        judge.feed([serve])
        if config.told_after_ms:
            judge.feed(rally.step(1e-3 * config.told_after_ms))
        try:
            rally.aim_racket(decision.target)
        except ConfigError:
            fate[i] = ReturnOutcome.OUT_OF_REACH
            continue
        outcome = _watch(rally, judge)
        fate[i] = _fate(outcome, decision)
        if outcome.case is Case.RETURNED:
            error_m[i] = np.linalg.norm(outcome.landing_m[:2] - controller.goal_m)
        progress((i + 1) / len(balls))
    return SimulatedReturns(fate, found.incoming, found.is_service, error_m)


def _watch(rally: MujocoRally, judge: RallyClassifier) -> BallOutcome:
    while rally.time_s < LONGEST_S:
        for outcome in judge.feed(rally.step()):
            return outcome
    raise ConfigError("a ball without an outcome", got=f"{LONGEST_S:g} s after its launch", where="play_known_balls")


def _fate(outcome: BallOutcome, decision: RacketDecision) -> ReturnOutcome:
    if outcome.case is Case.RETURNED:
        return ReturnOutcome.RETURNED
    assert decision.landing_m is not None
    as_meant = np.linalg.norm(outcome.landing_m[:2] - decision.landing_m) < AS_MEANT_M
    if not as_meant:  # nothing but a late racket can have done that; a miss has no landing at all
        return ReturnOutcome.NO_TIME
    if outcome.case is Case.OUT:
        beside = abs(float(outcome.landing_m[1])) > HALF_WIDTH_M
        return ReturnOutcome.WIDE if beside and outcome.landing_m[0] <= HALF_LENGTH_M else ReturnOutcome.LONG
    return ReturnOutcome.NET if outcome.case is Case.NET else ReturnOutcome.OWN_HALF
