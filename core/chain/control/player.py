"""The chain with a controller behind it: every prediction of the hitting plane is answered with a decision."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from core.chain.chain import ChainState, RallyChain
from core.chain.config import learned_physics
from core.chain.control.controller import BuiltInController, Controller, RacketDecision
from core.chain.control.step_test import CommandLatency
from core.events import Window
from core.trajectory.learned_constants import LearnedConstants


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


JITTERS: Final = 10.0
"""So many standard deviations of the jitter longer the last decision stands (choice: at 3 m/s a time that is 5 ms
another is made up for in 40 ms at 60 m/s^2)."""
FREEZE_S: Final = 0.012
"""So short before the impact nothing is decided any more: the ball is in front of the racket and their events mix, and
what is seen after the impact still looks like the old flight for some windows (our measurement: predictions of the time
that are 7 to 15 ms off)."""


class Player:
    """Sees and decides; what carries out the decisions is somebody else's."""

    def __init__(self, chain: RallyChain, controller: Controller) -> None:
        self.chain = chain
        self.controller = controller
        self.freeze_s = FREEZE_S
        """So short before the racket is to be there nothing is decided any more. Commands that take now longer, now
        shorter need more: a racket that is told another time just before it is due would have to jump."""
        self.lead_s = 0.0
        """The racket is told to be there so much before the ball: what its commands take to become motion. Whoever
        decides; a controller's own lead adds to it."""
        self._decision: RacketDecision | None = None
        self._informed: tuple[Controller, LearnedConstants, Controller] | None = None

    def lead_by(self, latency: CommandLatency) -> None:
        """Decide for a racket that is so late, by a step test."""
        self.lead_s = max(0.0, latency.mean_s)
        self.freeze_s = FREEZE_S + JITTERS * latency.jitter_s

    def reset(self) -> None:
        """Forget everything."""
        self.chain.reset()
        self._decision = None

    def forget_flight(self) -> None:
        """Expect a new ball."""
        self.chain.forget_flight()
        self._decision = None

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
        self._decision = answer or self._decision
        return PlayerState(state, self._decision, answer is not None, time.perf_counter() - started)

    def _answer(self, state: ChainState) -> RacketDecision | None:
        if not state.is_new or state.prediction is None or state.prediction.hit_plane is None:
            return None
        hit = state.prediction.hit_plane
        due_s = hit.t_s - self.lead_s
        due_s = due_s if self._decision is None else min(due_s, self._decision.target.t_s)
        if due_s - state.t_us * 1e-6 < self.freeze_s:
            return None
        p, v = hit.p_world_m, hit.v_world_mps
        spin, sigma = hit.spin_radps, hit.spin_sigma_radps
        controller = self._informed_controller()
        found = controller.decide(hit.t_s, p, v, stage=hit.stage, spin_radps=spin, spin_sigma_radps=sigma)
        if found is None:
            return None
        target = replace(found.target, t_s=found.target.t_s - self.lead_s) if self.lead_s else found.target
        return replace(found, t_us=state.t_us, target=target)

    def _informed_controller(self) -> Controller:
        """The controller with what the chain has learnt of the air, if it computes flights and nobody told them."""
        learned, controller = self.chain.learned, self.controller
        if learned is None or not learned.balls or not isinstance(controller, BuiltInController):
            return controller
        if self._informed is None or self._informed[0] is not controller or self._informed[1] is not learned:
            informed = controller.for_physics(learned_physics(learned, controller.task.physics))
            self._informed = controller, learned, informed
        return self._informed[2]
