"""Online learning in the live rally: one learner, shared by all browsers."""

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

NO_ROBOT: Final = "Learning is not possible: this source has no robot."
NO_OUTCOMES: Final = "Learning is not possible: this source does not report outcomes of strokes."


class LiveLearning:
    """Online learning of the rally. Thread-safe; methods that wait for the learner must not be called by the loop."""

    def __init__(self, player: LivePlayer, *, robot: bool, outcomes: bool) -> None:
        self._player = player
        self.reason = NO_ROBOT if not robot else "" if outcomes else NO_OUTCOMES
        """Why learning is not possible here; empty if it is."""
        self._lock = threading.Lock()
        self._learner: OnlineLearner | None = None
        self._before: LiveController = BuiltInController()
        self._closed = False

    @property
    def on(self) -> bool:
        """Whether the learning policy plays; it learns only then."""
        return isinstance(self._player.controller, LearningController)

    @property
    def progress(self) -> LearningProgress | None:
        """Progress since learning began; None before."""
        return None if self._learner is None else self._learner.progress

    def begin(self, start: LearningStart | None = None) -> None:
        """Let the learning policy play: continue the current one, else begin from `start` or untrained.

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
        """Let the previous controller play again; the learned policy is kept."""
        with self._lock:
            if self.on:
                self._player.use(self._before.aimed_at(self._player.controller.goal_m))

    def reset(self, start: LearningStart) -> None:
        """Discard the policy and begin again from `start`.

        Raises:
            RallyscopeError: if it cannot begin there; then nothing is forgotten.
        """
        with self._lock:
            if self._learner is not None:
                self._learner.reset(start)

    def save(self, run: Path) -> None:
        """Save the current policy as a run.

        Raises:
            RallyscopeError: if it cannot be written, or nothing was begun yet.
        """
        learner = self._learner
        if learner is None:
            raise CommandError("no policy was learned yet")
        learner.save(run)

    def close(self) -> None:
        """End the learner's thread."""
        with self._lock:
            self._closed = True
            if self._learner is not None:
                self._learner.close()
