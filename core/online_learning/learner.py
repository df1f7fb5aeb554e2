"""Online learning of the landing model from its own strokes in a live rally, on a thread of its own."""

from __future__ import annotations

import logging
import math
import queue
import threading
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from core.chain.control.controller import RacketDecision
from core.errors import ConfigError
from core.learning.agents.policy import Policy
from core.live.live_snapshot import FinishedBall
from core.online_learning.controller import ExploringPolicy, LearningController
from core.online_learning.progress import LearnedBall, LearningProgress, landing_error_mm
from core.online_learning.start import LearningStart
from core.physics import TaskConfig

if TYPE_CHECKING:
    from core.online_learning.online_agent import OnlineAgent

logger = logging.getLogger(__name__)
ANOTHER_BALL_S: Final = 0.3
"""Largest difference of predicted arrival times of the same ball."""
ENDED: Final = "learning has ended with its rally"
DECISIONS: Final = 64
"""Decisions remembered to recognise own strokes: more than in one flight."""


@dataclass(frozen=True, slots=True, eq=False)
class _Played:
    """A ball to learn from, unless learning was reset since."""

    generation: int
    ball: FinishedBall
    random: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Reset:
    start: LearningStart
    done: Future[None]


@dataclass(frozen=True, slots=True, eq=False)
class _Save:
    run: Path
    done: Future[None]


class OnlineLearner:
    """Has a policy from the first `reset` on. All methods may be called from any thread; `close` it."""

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._lock = threading.Lock()
        self._explore = np.random.default_rng([seed, 1])
        self._generation = 0
        self._start: LearningStart | None = None
        self._policy: Policy | None = None
        self._ball: ExploringPolicy | None = None
        self._ball_s = math.nan
        self._decisions: deque[tuple[RacketDecision, ExploringPolicy]] = deque(maxlen=DECISIONS)
        self._progress: LearningProgress | None = None
        self._closed = False
        self._asked: queue.SimpleQueue[_Played | _Reset | _Save | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="online-learning", daemon=True)
        self._thread.start()

    @property
    def progress(self) -> LearningProgress | None:
        """Current progress; None before the first `reset`."""
        return self._progress

    @property
    def policy(self) -> Policy | None:
        """Newest policy; None before the first `reset`."""
        return self._policy

    def reset(self, start: LearningStart) -> None:
        """Discard everything, also the current ball, and begin from a start; returns when there is a policy.

        Raises:
            RallyscopeError: if that is no start; then all stays as it was.
        """
        self._ask(done := Future(), _Reset(start, done))

    def save(self, run: Path) -> None:
        """Write policy, networks and balls as a run, to be chosen, evaluated or started from.

        Raises:
            RallyscopeError: if it cannot be written, or nothing was begun yet.
        """
        self._ask(done := Future(), _Save(run, done))

    def controller(self, goal_m: ArrayLike) -> LearningController:
        """Controller that plays the policy, aimed at a goal (2,); only after the first `reset`."""
        return LearningController(self, goal_m)

    def note(self, ball: FinishedBall) -> None:
        """Report the outcome of a ball; balls of other controllers are ignored. Returns at once."""
        decision = ball.decision
        if decision is None:
            return
        with self._lock:  # the player stamps a decision with its time, but keeps its arrays
            mine = next((by for one, by in self._decisions if one.action is decision.action), None)
            if mine is not None:
                self._asked.put(_Played(self._generation, ball, mine.random is not None))

    def close(self) -> None:
        """Stop the thread after its current task; queued tasks are dropped."""
        with self._lock:
            self._closed = True
            self._asked.put(None)
        self._thread.join()

    # For the controller, in the player's thread.

    @property
    def task(self) -> TaskConfig:
        """Task of the learner."""
        assert self._start is not None
        return self._start.config.environment.task

    def policy_for(self, t_c_s: float) -> ExploringPolicy:
        """The newest policy for a new ball; for a flying ball, the one it began with."""
        with self._lock:
            if self._ball is None or not abs(t_c_s - self._ball_s) < ANOTHER_BALL_S:
                self._ball = self._next_policy()
            self._ball_s = t_c_s
            return self._ball

    def decided(self, decision: RacketDecision) -> None:
        """Remember a decision, whose ball will be learned from."""
        with self._lock:
            if self._ball is not None:
                self._decisions.append((decision, self._ball))

    def _next_policy(self) -> ExploringPolicy:
        assert self._policy is not None and self._start is not None and self._progress is not None
        exploration, balls = self._start.config.exploration, self._progress.learned
        size = 4 if self._policy.chooses_speed else 3
        uniform, normal = self._explore.uniform(-1, 1, size), self._explore.standard_normal(size)
        is_random = balls < exploration.random_episodes
        return ExploringPolicy(self._policy, exploration.noise_at(balls) * normal, uniform if is_random else None)

    # The learner's own thread.

    def _ask(self, done: Future[None], request: _Reset | _Save) -> None:
        with self._lock:
            if self._closed:
                raise ConfigError(ENDED)
            self._asked.put(request)
        done.result()

    def _run(self) -> None:
        agent: OnlineAgent | None = None
        while (asked := self._asked.get()) is not None and not self._closed:
            if isinstance(asked, _Played):
                if agent is not None and asked.generation == self._generation:
                    self._learn(agent, asked)
                continue
            try:
                agent = self._answer(agent, asked)
                asked.done.set_result(None)
            except Exception as error:  # noqa: BLE001 - handed to whoever asked
                asked.done.set_exception(error)
        self._refuse(asked)

    def _answer(self, agent: OnlineAgent | None, asked: _Reset | _Save) -> OnlineAgent | None:
        if isinstance(asked, _Save):
            if agent is None:
                raise ConfigError("nothing was learned yet", where=asked.run)
            agent.save(asked.run)
            return agent
        from core.online_learning.online_agent import OnlineAgent  # late: what it needs takes a moment to load

        fresh = OnlineAgent(asked.start, self._seed)
        with self._lock:
            self._generation += 1
            self._start, self._policy = asked.start, fresh.policy
            self._ball = None
            self._decisions.clear()
            self._progress = LearningProgress(asked.start.name, ())
        return fresh

    def _learn(self, agent: OnlineAgent, played: _Played) -> None:
        ball, before = played.ball, self._progress
        assert ball.decision is not None and before is not None
        chosen = ball.decision.stage == "post"  # before it the racket only moves
        problem = before.problem
        if chosen:
            try:
                agent.learn(ball)
            except Exception as error:
                logger.exception("a ball was not learned from")
                chosen, problem = False, f"{type(error).__name__}: {error}"
        row = LearnedBall(ball.case, landing_error_mm(ball), chosen, chosen and played.random)
        with self._lock:
            self._policy = agent.policy
            self._progress = replace(before, balls=(*before.balls, row), problem=problem)

    def _refuse(self, asked: _Played | _Reset | _Save | None) -> None:
        """Fail the waiting requests: the learner is closed."""
        while True:
            if isinstance(asked, _Reset | _Save):
                asked.done.set_exception(ConfigError(ENDED))
            try:
                asked = self._asked.get_nowait()
            except queue.Empty:
                return
