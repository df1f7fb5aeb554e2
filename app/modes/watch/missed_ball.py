"""The last missed ball, with buttons to Tune and Label."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app.background.jobs import LatestWins
from app.formatting import html_text
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

TITLES: Final = {"not seen": "Last gap of the detector", "not returned": "Last miss"}
LAST: Final = 1e6
"""Position of the panel: after all other controls."""


class MissedPanel:
    """Shows the missed ball in one browser."""

    def __init__(self, gui: viser.GuiApi, look: Callable[[ModeName], None]) -> None:
        # Last: it appears and disappears, and must not move other controls.
        self._folder = gui.add_folder(TITLES["not returned"], visible=False, order=LAST)
        with self._folder:
            self._text = gui.add_html("")
            tune = gui.add_button("Look at it in Tune", icon=viser.Icon.ADJUSTMENTS, hint="The same window and camera")
            label = gui.add_button("Label it", icon=viser.Icon.TARGET, hint="The same moment and camera")
        when_clicked(tune, lambda: look("Tune"))
        when_clicked(label, lambda: look("Label"))

    def show(self, missed: MissedBall | None, *, copies: bool) -> None:
        """Show the missed ball; `copies`: the rally is live and has to be frozen first."""
        self._folder.visible = missed is not None
        if missed is not None and self._folder.label != (title := TITLES[missed.kind]):
            self._folder.label = title
        if missed is not None and self._text.content != (content := missed_html(missed, copies=copies)):
            self._text.content = content


def missed_html(missed: MissedBall, *, copies: bool) -> str:
    """HTML of what was missed, in one or two lines."""
    camera, ms = html_text(missed.camera), missed.unseen_us / 1e3
    if missed.kind == "not seen":
        text = f"the detector missed the ball in {camera} for {ms:.0f} ms. The track was not lost"
    elif missed.skipped_us:  # the detector had nothing to look at, and begins anew after it
        text = f"the ball was not returned; {missed.skipped_us / 1e3:.0f} ms of its flight were skipped: this machine "
        text += "was busy, and the racket's command came late. Choose a slower Pace"
    elif missed.away_m:
        text = f"the ball was not returned; the racket was still {1e3 * missed.away_m:.0f} mm from where it was sent: "
        text += "the command came late, or asked for too much"
    elif missed.unseen_us:
        text = f"the ball was not returned; the detector missed it in {camera} for {ms:.0f} ms"
    else:
        text = "the ball was not returned; it was seen up to the racket"
    text = f"<b>{missed.t_us / 1e6:.3f} s</b>: {text}."
    if copies:
        text += "<br>" + muted("The last 20 s will be saved as a recording.")
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
        """Moment to show once the live rally is frozen."""
        self._asked: object = None
        self._asked_s = float("-inf")

    def use_recording(self, recording: Recording) -> None:
        """Another recording was opened: the frozen one, or any other."""
        self._missed, self._asked = None, None
        self._panel.show(None, copies=False)
        moment_us, wanted = self._copy.moment_in(recording), self._wanted
        self._wanted = None
        self._copy.forget()
        if moment_us is not None and wanted is not None:
            mode, missed = wanted
            self._host.send(LookInto(mode, missed.camera, moment_us))

    def tick(self, history: RallyHistory | None, now_us: int, wall_s: float) -> None:
        """Search again when the time or the history has changed; `history` is None for a recording that is not
        stereo.
        """
        recording = self._host.recording
        if history is None or recording is None or wall_s - self._asked_s < LOOK_EVERY_S:
            return
        if isinstance(recording, RingRecording):  # the result is the same for all browsers on this recording
            now_us = now_us // LIVE_STEP_US * LIVE_STEP_US
        key = (recording.uuid, now_us, min(history.followed_us, now_us), history.outcome_count)
        if key != self._asked:
            self._asked, self._asked_s = key, wall_s
            self._search.submit(MissedBallRequest(recording, history, now_us))

    def close(self) -> None:
        """The browser has disconnected."""
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
