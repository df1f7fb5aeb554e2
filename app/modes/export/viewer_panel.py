"""The controls of the stream to a Rerun viewer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app import theme
from app.export.viewer_streamer import StreamState
from app.formatting.file_text import html_text
from app.formatting.percent import percent
from app.widgets import when_clicked

STYLE: Final = "padding:2px 12px;font-size:12.5px;line-height:1.45;overflow-wrap:anywhere"


class ViewerPanel:
    """Controls of the Rerun viewer in one browser; hidden where the command line gave no viewer."""

    def __init__(
        self, gui: viser.GuiApi, address: str | None, start: Callable[[], None], stop: Callable[[], None]
    ) -> None:
        self._shown = address is not None
        with gui.add_folder("Rerun viewer", visible=self._shown):
            where = html_text(address or "")
            gui.add_html(f"<div style='{STYLE};color:{theme.MUTED}'>{where}</div>")
            self._start = gui.add_button(
                "Stream to Rerun",
                icon=viser.Icon.BROADCAST,
                hint="What the Rerun file holds; a live rally from now on",
            )
            self._stop = gui.add_button("Stop streaming", icon=viser.Icon.PLAYER_STOP, color="red", visible=False)
            self._status = gui.add_html("")
        when_clicked(self._start, start)
        when_clicked(self._stop, stop)

    def show(self, state: StreamState | None) -> None:
        """Follow the stream."""
        if not self._shown:
            return
        running = state is not None and state.running
        self._start.visible, self._stop.visible = not running, running
        content = "" if state is None else stream_html(state)
        if self._status.content != content:
            self._status.content = content


def stream_html(state: StreamState) -> str:
    """One line about the latest stream."""
    if state.running:
        share = f" {percent(state.share)}" if state.share else ""
        remark = f"; {state.message}" if state.message else ""
        return f"<div style='{STYLE}'>{html_text(state.name)} is being sent{share}{html_text(remark)}</div>"
    colour = theme.BAD if state.failed else theme.MUTED
    return f"<div style='{STYLE};color:{colour}'>{html_text(state.message)}</div>"
