"""The last missed ball, and the ways from there to Tune and Label."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app.background.worker import LatestWins
from app.formatting.text import html_text
from app.modes.live_copy import LiveCopy
from app.modes.mode import ModeHost
from app.modes.watch.figures import muted
from app.state.client_state import ModeName
from app.state.commands import LookInto
from app.widgets import when_clicked
from core.history.missed_balls import MissedBall, MissedBallRequest
from core.history.rally_history import RallyHistory
from core.live.ring_recording import RingRecording
from core.recordings import Recording

LAST: Final = 1e6
"""In the order of the controls."""


class MissedPanel:
    """Shows the missed ball in one browser."""

    def __init__(self, gui: viser.GuiApi, look: Callable[[ModeName], None]) -> None:
        # Last: it comes and goes with the rally, and nothing that is about to be clicked may move.
        self._folder = gui.add_folder("Last miss", visible=False, order=LAST)
        with self._folder:
            self._text = gui.add_html("")
            tune = gui.add_button("Look at it in Tune", icon=viser.Icon.ADJUSTMENTS, hint="The same window and camera")
            label = gui.add_button("Label it", icon=viser.Icon.TARGET, hint="The same moment and camera")
        when_clicked(tune, lambda: look("Tune"))
        when_clicked(label, lambda: look("Label"))

    def show(self, missed: MissedBall | None, *, copies: bool) -> None:
        """Say which it is; `copies`: the rally is live and has to be frozen to be looked at."""
        self._folder.visible = missed is not None
        if missed is not None and self._text.content != (content := missed_html(missed, copies=copies)):
            self._text.content = content


def missed_html(missed: MissedBall, *, copies: bool) -> str:
    """What was missed, in a line or two."""
    camera, ms = html_text(missed.camera), missed.unseen_us / 1e3
    if missed.kind == "not seen":
        text = f"the detector did not see the ball in {camera} for {ms:.0f} ms. That alone loses no ball"
    elif missed.unseen_us:
        text = f"the ball did not come back; the detector did not see it in {camera} for {ms:.0f} ms"
    else:
        text = "the ball did not come back; the cameras saw it up to the racket"
    text = f"<b>{missed.t_us / 1e6:.3f} s</b>: {text}."
    if copies:
        text += "<br>" + muted("What is remembered since becomes a recording.")
    return f"<div style='font-size:12.5px;padding:2px 12px;line-height:1.45'>{text}</div>"


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
