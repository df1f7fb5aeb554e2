"""The last missed ball, and the ways from there to Tune and Label."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app.formatting.file_text import html_text
from app.modes.watch.figures import muted
from app.state.client_state import ModeName
from app.widgets import when_clicked
from core.history.missed_balls import MissedBall

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
