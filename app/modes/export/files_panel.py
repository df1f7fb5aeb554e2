"""How the export goes, the files that were made, and the stream to a Rerun viewer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app import theme
from app.export.exporter import ExportedFile, ExportState
from app.export.viewer_streamer import StreamState
from app.formatting import html_text, percent, size_text
from app.modes.mode import STYLE, state_html
from app.widgets import Listing, when_clicked

SHOWN: Final = 12


class ExportFilesPanel:
    """The exported files that one browser can download."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.export = gui.add_button("Export", icon=viser.Icon.DOWNLOAD, color="teal")
        self.cancel = gui.add_button("Cancel", icon=viser.Icon.X, color="red", visible=False)
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._status = gui.add_html("")
        with gui.add_folder("Made so far"):
            self._files = Listing(gui, "File", lambda _: None)
            self.download = gui.add_button("Download", icon=viser.Icon.FILE_DOWNLOAD, visible=False)
            self._table = gui.add_html("")
        self._newest: str | None = None

    @property
    def chosen(self) -> str | None:
        """The file that is chosen."""
        return self._files.chosen

    def show(self, state: ExportState | None, files: tuple[ExportedFile, ...]) -> None:
        """Follow the export and the folder."""
        running = state is not None and state.running
        self.export.visible = not running
        self.cancel.visible = self._progress.visible = running
        if state is not None:
            self._progress.value = 100.0 * state.share
        self._status.content = state_html(state)
        self._files.offer(tuple(file.name for file in files))
        newest = files[0].name if files else None
        if newest != self._newest:  # what was just made is what is wanted
            self._newest = newest
            if newest is not None:
                self._files.show(newest)
        self.download.visible = bool(files)
        self._table.content = files_html(files)


def result_of_kind(state: ExportState | None, made_as: str | None, kind: str) -> ExportState | None:
    """The latest export if it runs or is of the kind that is chosen, or of one that this browser does not know."""
    return state if state is None or state.running or made_as in (None, kind) else None


def files_html(files: tuple[ExportedFile, ...]) -> str:
    """The newest files with their sizes."""
    if not files:
        return f"<div style='{STYLE};color:{theme.MUTED}'>Nothing yet.</div>"
    rows = [
        f"<tr><td style='overflow-wrap:anywhere'>{html_text(file.name)}</td>"
        f"<td style='text-align:right;white-space:nowrap'>{size_text(file.size)}</td></tr>"
        for file in files[:SHOWN]
    ]
    more = f"<div style='color:{theme.MUTED}'>and {len(files) - SHOWN} more</div>" if len(files) > SHOWN else ""
    return f"<div style='{STYLE}'><table style='width:100%'>{''.join(rows)}</table>{more}</div>"


VIEWER_STYLE: Final = "padding:2px 12px;font-size:12.5px;line-height:1.45;overflow-wrap:anywhere"


class ViewerPanel:
    """Controls of the Rerun viewer in one browser; hidden where the command line gave no viewer."""

    def __init__(
        self, gui: viser.GuiApi, address: str | None, start: Callable[[], None], stop: Callable[[], None]
    ) -> None:
        self._shown = address is not None
        with gui.add_folder("Rerun viewer", visible=self._shown):
            where = html_text(address or "")
            gui.add_html(f"<div style='{VIEWER_STYLE};color:{theme.MUTED}'>{where}</div>")
            self._start = gui.add_button(
                "Stream to Rerun",
                icon=viser.Icon.BROADCAST,
                hint="The same data as the Rerun file; a live rally from now on",
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
        return f"<div style='{VIEWER_STYLE}'>{html_text(state.name)} is being sent{share}{html_text(remark)}</div>"
    colour = theme.BAD if state.failed else theme.MUTED
    return f"<div style='{VIEWER_STYLE};color:{colour}'>{html_text(state.message)}</div>"
