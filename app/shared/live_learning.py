"""The policy of the live rally that learns while it plays: one learner for the rally, whoever looks."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Final

from core.chain.control.controller import BuiltInController, LiveController
from core.errors import CommandError
from core.live.live_player import LivePlayer
from core.online_learning.controller import LearningController
from core.online_learning.learner import OnlineLearner
from core.online_learning.progress import LearningProgress
from core.online_learning.start import LearningStart, start_from_nothing

NO_ROBOT: Final = "Nothing to learn with: this source has no robot."
NO_OUTCOMES: Final = "Nothing to learn from: this source does not tell what became of the strokes."


class LiveLearning:
    """All methods may be called from any thread; those that wait for the learner are not for the loop."""

    def __init__(self, player: LivePlayer, *, robot: bool, outcomes: bool) -> None:
        self._player = player
        self.reason = NO_ROBOT if not robot else "" if outcomes else NO_OUTCOMES
        """Why nothing can be learned here; empty where it can."""
        self._lock = threading.Lock()
        self._learner: OnlineLearner | None = None
        self._before: LiveController = BuiltInController()
        self._closed = False

    @property
    def on(self) -> bool:
        """Whether the learning policy plays; without that nothing is learned."""
        return isinstance(self._player.controller, LearningController)

    @property
    def progress(self) -> LearningProgress | None:
        """Since learning began; None before."""
        return None if self._learner is None else self._learner.progress

    def begin(self, start: LearningStart | None = None) -> None:
        """Let the learning policy play: from where it was, or if there is none yet from `start`, else from nothing.

        Raises:
            RallyscopeError: if it cannot learn here, or not from there.
        """
        with self._lock:
            if self.reason or self._closed:
                raise CommandError("the policy cannot learn here", got=self.reason or "the rally has ended")
            self._learner = learner = self._learner or OnlineLearner()
            if learner.progress is None:
                learner.reset(start or start_from_nothing())
                self._player.add_ball_listener(learner.note)
            if not self.on:
                self._before = self._player.controller
                self._player.use(learner.controller(self._before.goal_m))

    def stop(self) -> None:
        """Let the controller before it play again; what was learned stays."""
        with self._lock:
            if self.on:
                self._player.use(self._before.aimed_at(self._player.controller.goal_m))

    def reset(self, start: LearningStart) -> None:
        """Forget everything and begin again from there.

        Raises:
            RallyscopeError: if it cannot begin there; then nothing is forgotten.
        """
        with self._lock:
            if self._learner is not None:
                self._learner.reset(start)

    def save(self, run: Path) -> None:
        """Keep what is known now as a run.

        Raises:
            RallyscopeError: if it cannot be written, or nothing was begun yet.
        """
        learner = self._learner
        if learner is None:
            raise CommandError("nothing was learned yet")
        learner.save(run)

    def close(self) -> None:
        """End the learner's thread."""
        with self._lock:
            self._closed = True
            if self._learner is not None:
                self._learner.close()
