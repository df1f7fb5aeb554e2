"""Looks for the last missed ball before the cursor, and opens its moment in another mode."""

from __future__ import annotations

from typing import Final

from app.background.worker import LatestWins
from app.modes.live_copy import LiveCopy
from app.modes.mode import ModeHost
from app.modes.watch.missed.missed_panel import MissedPanel
from app.state.client_state import ModeName
from app.state.commands import LookInto
from core.history.missed_balls import MissedBall, MissedBallRequest
from core.history.rally_history import RallyHistory
from core.live.ring_recording import RingRecording
from core.recordings import Recording

LOOK_EVERY_S: Final = 0.7
LIVE_STEP_US: Final = 500_000


class MissedBallSearch:
    """Finds the missed ball nearest to one browser's time cursor. Called by its loop."""

    def __init__(self, host: ModeHost) -> None:
        self._host = host
        self._panel = MissedPanel(host.client.gui, lambda mode: host.later(lambda: self._look(mode)))
        self._search = LatestWins(host.pool, host.services.missed_balls, self._found, self._failed)
        self._copy = LiveCopy(host)
        self._missed: MissedBall | None = None
        self._wanted: tuple[ModeName, MissedBall] | None = None
        """What is to be shown once the live rally is frozen."""
        self._asked: object = None
        self._asked_s = float("-inf")

    def use_recording(self, recording: Recording) -> None:
        """Another recording was opened: the one that was frozen, or anything else."""
        self._missed, self._asked = None, None
        self._panel.show(None, copies=False)
        moment_us, wanted = self._copy.moment_in(recording), self._wanted
        self._wanted = None
        self._copy.forget()
        if moment_us is not None and wanted is not None:
            mode, missed = wanted
            self._host.send(LookInto(mode, missed.camera, moment_us))

    def tick(self, history: RallyHistory | None, now_us: int, wall_s: float) -> None:
        """Look again where time or what is known has moved; `history` is None where there is no rally in space."""
        recording = self._host.recording
        if history is None or recording is None or wall_s - self._asked_s < LOOK_EVERY_S:
            return
        if isinstance(recording, RingRecording):  # all browsers that follow it look for the same
            now_us = now_us // LIVE_STEP_US * LIVE_STEP_US
        key = (recording.uuid, now_us, min(history.followed_us, now_us), history.outcome_count)
        if key != self._asked:
            self._asked, self._asked_s = key, wall_s
            self._search.submit(MissedBallRequest(recording, history, now_us))

    def close(self) -> None:
        """The browser is gone."""
        self._search.close()
        self._copy.close()

    def _found(self, request: MissedBallRequest, missed: MissedBall | None) -> None:
        self._host.later(lambda: self._show(request, missed))

    def _show(self, request: MissedBallRequest, missed: MissedBall | None) -> None:
        if request.recording is self._host.recording:
            self._missed = missed
            self._panel.show(missed, copies=isinstance(request.recording, RingRecording))

    def _failed(self, error: Exception) -> None:
        self._host.later(lambda: self._host.report(error))

    def _look(self, mode: ModeName) -> None:
        missed, recording, state = self._missed, self._host.recording, self._host.state
        if missed is None or recording is None or state is None:
            return
        if isinstance(recording, RingRecording):
            self._copy.begin(recording, missed.t_us, state.step_us, lambda: None)
            self._wanted = (mode, missed)
        else:
            self._host.send(LookInto(mode, missed.camera, missed.t_us))
