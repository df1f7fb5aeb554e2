"""The chain with a controller behind it: every prediction of the hitting plane is answered with a decision."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import ChainState, RallyChain
from core.chain.config import HitRule, learned_physics
from core.chain.control.controller import BuiltInController, Controller, RacketDecision
from core.chain.control.hit_choice import (
    FaceTrajectory,
    HitChoice,
    HitChoiceConfig,
    RacketReach,
    choose_hit,
)
from core.chain.control.hit_selector import COMMAND_S, ChoosesHit, HitSelector
from core.chain.control.step_test import CommandLatency
from core.events import Window
from core.simulation.episodes.racket import RacketConfig
from core.trajectory import Prediction
from core.trajectory.learned_constants import LearnedConstants
from core.trajectory.prediction import HitPlane


@dataclass(frozen=True, slots=True, eq=False)
class PlayerState:
    """What is known and decided after one step."""

    chain: ChainState
    decision: RacketDecision | None
    """The newest of this flight, maybe of an earlier step; None before there is one."""
    is_new: bool
    """Whether it was decided in this step."""
    control_s: float
    """Wall time of deciding; the chain's stages tell their own."""
    choice: HitChoice | None = None
    """Where the ball is to be hit, with the other places that were looked at; None at the paper's plane."""


JITTERS: Final = 10.0
"""So many standard deviations of the jitter longer the last decision stands (choice: at 3 m/s a time that is 5 ms
another is made up for in 40 ms at 60 m/s^2)."""
FREEZE_S: Final = 0.012
"""So short before the impact nothing is decided any more: the ball is in front of the racket and their events mix, and
what is seen after the impact still looks like the old flight for some windows (our measurement: predictions of the time
that are 7 to 15 ms off)."""


def choose_from_rest(prediction: Prediction, controller: BuiltInController, bounces_us: Sequence[int]) -> HitChoice:
    """Where the simulated racket would hit the ball if it still waits at home; `bounces_us` are those seen so far."""
    reach = RacketReach.of_config(RacketConfig())
    racket = FaceTrajectory(prediction.t_us * 1e-6 + COMMAND_S, np.array(reach.home_m), np.zeros(3))
    bounced_s = 1e-6 * bounces_us[-1] if bounces_us else None
    return choose_hit(prediction, controller.strokes(), racket, reach, HitChoiceConfig(), bounced_s=bounced_s)


class Player:
    """Sees and decides; what carries out the decisions is somebody else's."""

    def __init__(
        self,
        chain: RallyChain,
        controller: Controller,
        *,
        hit: HitRule = "paper",
        reach: RacketReach | None = None,
        choice: HitChoiceConfig | None = None,
    ) -> None:
        """With the hit `chosen`, a controller that can meet the ball elsewhere than at the plane does so where it can
        best be met, within the racket's reach (by default that of the simulated one): the built-in one, and a policy
        that was trained so.
        """
        self.chain = chain
        self.hit: HitRule = hit
        self.reach = reach or RacketReach.of_config(RacketConfig())
        self._hits = HitSelector(choice)
        self.rest_m: NDArray[np.float64] | None = None
        """(3,) where the racket waits, as it says itself; None: at the home of `reach`."""
        self._forget_hit()
        self.controller = controller
        self.freeze_s = FREEZE_S
        """So short before the racket is to be there nothing is decided any more. Commands that take now longer, now
        shorter need more: a racket that is told another time just before it is due would have to jump."""
        self.lead_s = 0.0
        """The racket is told to be there so much before the ball: what its commands take to become motion. Whoever
        decides; a controller's own lead adds to it."""
        self._decision: RacketDecision | None = None
        self._informed: tuple[tuple[Controller, LearnedConstants, bool], Controller] | None = None

    def lead_by(self, latency: CommandLatency) -> None:
        """Decide for a racket that is so late, by a step test."""
        self.lead_s = max(0.0, latency.mean_s)
        self.freeze_s = FREEZE_S + JITTERS * latency.jitter_s

    def reset(self) -> None:
        """Forget everything."""
        self.chain.reset()
        self._decision = None
        self._forget_hit()

    def forget_flight(self) -> None:
        """Expect a new ball."""
        self.chain.forget_flight()
        self._decision = None
        self._forget_hit()

    def _forget_hit(self) -> None:
        self._hits.forget_flight()
        self._racket: FaceTrajectory | None = None  # where it was when the last decision took effect; None at home

    def step(self, windows: Mapping[str, Window]) -> PlayerState:
        """Take the next window of each camera, in order of time.

        Raises:
            RecordingError: for a camera that the chain does not have.
        """
        state = self.chain.step(windows)
        started = time.perf_counter()
        answer = self._answer(state)
        if state.prediction is None:
            self._decision = None
            self._forget_hit()
        if answer is not None and self.hit == "chosen":
            self._racket = self._motion(state)
        self._decision = answer or self._decision
        took_s = time.perf_counter() - started
        return PlayerState(state, self._decision, answer is not None, took_s, self._hits.choice)

    def _answer(self, state: ChainState) -> RacketDecision | None:
        if not state.is_new or state.prediction is None or self._is_late(state, np.inf):
            return None
        controller = self._informed_controller()
        hit = self._place(state, state.prediction, controller)
        if hit is None or self._is_late(state, hit.t_s - self.lead_s):
            return None
        p, v = hit.p_world_m, hit.v_world_mps
        spin, sigma = hit.spin_radps, hit.spin_sigma_radps
        found = controller.decide(hit.t_s, p, v, stage=hit.stage, spin_radps=spin, spin_sigma_radps=sigma)
        if found is None:
            return None
        target = replace(found.target, t_s=found.target.t_s - self.lead_s) if self.lead_s else found.target
        return replace(found, t_us=state.t_us, target=target)

    def _is_late(self, state: ChainState, due_s: float) -> bool:
        """Whether it is too late to decide on a racket that is to be there at `due_s`, or at its last target's time."""
        due_s = due_s if self._decision is None else min(due_s, self._decision.target.t_s)
        return due_s - state.t_us * 1e-6 < self.freeze_s

    def _place(self, state: ChainState, prediction: Prediction, controller: Controller) -> HitPlane | None:
        """Where the ball is hit: as chosen, or at the plane; there too where no stroke returns it."""
        model = controller.strokes() if self.hit == "chosen" and isinstance(controller, ChoosesHit) else None
        if model is None:
            self._hits.choice = None
            return prediction.hit_plane
        return self._hits.place(prediction, model, lambda: self._motion(state), self.reach, state.bounces_us)

    def _motion(self, state: ChainState) -> FaceTrajectory:
        """The racket when a decision of now takes effect, on its way as the last one had it; at home without one."""
        now_s = state.t_us * 1e-6 + COMMAND_S + self.lead_s
        if self._racket is None or self._decision is None:
            rest = np.array(self.reach.home_m) if self.rest_m is None else self.rest_m
            return FaceTrajectory(now_s, rest, np.zeros(3))
        target = self._decision.target
        return self._racket.towards(target.t_s + self.lead_s, target.p_m, target.v_mps, now_s)

    def _informed_controller(self) -> Controller:
        """The controller with what the chain has learnt of the air, if it computes flights and nobody told them.

        Whether there is air the present flight says too: the first one shows it before its bounce.
        """
        learned, controller = self.chain.learned, self.controller
        if learned is None or not isinstance(controller, BuiltInController):
            return controller
        there = self.chain.air >= 0.5
        if there and not learned.balls:
            return controller
        key = controller, learned, there
        if self._informed is None or self._informed[0] != key:
            physics = learned_physics(replace(learned, air=float(there)), controller.task.physics)
            self._informed = key, controller.for_physics(physics)
        return self._informed[1]
