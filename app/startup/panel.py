"""The card that a browser shows while the app is being prepared, and its wait for its first recording, such as a
live rally in preparation.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

import viser

from app import theme
from app.formatting import html_text
from app.shared.library import Library
from app.startup.startup import OWN_STEPS, Preparation, Step

PLACE_PX: Final = (8, -8)
SIZE_PX: Final = (430, 244)
RALLY_COMES: Final = (
    "Meanwhile you see a recorded rally at half speed, or can open a recording. The live rally will appear here."
)
RALLY_RUNS: Final = "The live rally is ready. The demo recording will appear in the list of recordings."
SIGNS: Final = {"waiting": "&#9675;", "running": "&#9684;", "done": "&#10003;", "failed": "&#10007;"}


class PreparationPanel:
    """The card of the first start, for one browser."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._panel = gui.add_panel(visible=False)
        with self._panel.add_tab("Getting ready", viser.Icon.HOURGLASS):
            self._card = gui.add_html("")
        self._panel.float(x=PLACE_PX[0], y=PLACE_PX[1], width=SIZE_PX[0], height=SIZE_PX[1])

    def show(self, steps: Sequence[Step]) -> None:
        """Show the steps; nothing once all are done."""
        content = card_html(steps)
        if content and self._card.content != content:
            self._card.content = content
        self._panel.visible = bool(content)


def card_html(steps: Sequence[Step]) -> str:
    """The steps with their progress; empty if all are done."""
    if all(step.state == "done" for step in steps):
        return ""
    now_s = time.monotonic()
    rows = "".join(_row(step, now_s) for step in steps)
    rally_runs = any(step.title == OWN_STEPS["rally"].title and step.state == "done" for step in steps)
    note = RALLY_RUNS if rally_runs else RALLY_COMES
    return (
        f"<div style='font-size:13px;padding:6px 14px;line-height:1.5'>{rows}"
        f"<div style='color:{theme.MUTED};padding-top:6px'>{note}</div></div>"
    )


def remaining_text(remaining_s: float | None) -> str:
    """An estimate in words, coarse as it is; empty if there is none."""
    if remaining_s is None:
        return ""
    if remaining_s < 90:
        return f"about {max(5, 5 * round(remaining_s / 5))} s left"
    return f"about {round(remaining_s / 60)} minutes left"


def _row(step: Step, now_s: float) -> str:
    colours = {"waiting": theme.MUTED, "running": "inherit", "done": theme.GOOD, "failed": theme.BAD}
    html = html_text(step.title)
    if step.state == "running":
        html += f" <b>{step.share:.0%}</b>" if step.share else " ..."
        hint = ", ".join(filter(None, (step.hint, remaining_text(step.remaining_s(now_s)))))
        html += f"<div style='color:{theme.MUTED};font-size:11.5px'>{html_text(hint)}</div>" if hint else ""
        html += _bar(step.share)
    elif step.state == "failed":
        html += f"<div style='font-size:11.5px'>{html_text(step.problem)}</div>"
    sign = f"<span style='display:inline-block;width:20px'>{SIGNS[step.state]}</span>"
    return f"<div style='color:{colours[step.state]};display:flex'>{sign}<div style='flex:1'>{html}</div></div>"


def _bar(share: float) -> str:
    filled = f"<div style='width:{share:.0%};height:4px;background:rgb{theme.BRAND_RGB};border-radius:2px'></div>"
    return f"<div style='background:#3a3d44;height:4px;border-radius:2px;margin:2px 0 4px'>{filled}</div>"


class AwaitedRecording:
    """Owned by the browser's session, used by the loop only."""

    def __init__(
        self, library: Library, preparation: Preparation | None, add_card: Callable[[], PreparationPanel]
    ) -> None:
        """`preparation` is shown as a card until it is over; None if there is nothing to prepare."""
        self._library = library
        self._preparation = preparation
        self._card = None if preparation is None or preparation.over else add_card()
        self._name: str | None = None

    @property
    def waiting(self) -> bool:
        """Whether it is still waiting."""
        return self._name is not None

    @property
    def is_preparing(self) -> bool:
        """Whether it waits for what is still being prepared."""
        return self._name is not None and self._card is not None

    def expect(self, name: str | None) -> None:
        """Wait for this recording; None cancels the wait, as another was chosen."""
        self._name = name

    def tick(self) -> str | None:
        """Show the progress; returns the recording's name once it exists."""
        if self._card is not None and self._preparation is not None:
            self._card.show(self._preparation.steps)
            if self._preparation.over:
                self._card = None
        if self._name is None or not self._library.has(self._name):
            return None
        arrived, self._name = self._name, None
        return arrived
