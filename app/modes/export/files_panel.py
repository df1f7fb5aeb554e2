"""How the export goes, and the files that were made."""

from __future__ import annotations

from typing import Final

import viser

from app import theme
from app.export.exporter import ExportedFile, ExportState
from app.formatting.file_size import size_text
from app.formatting.file_text import html_text
from app.modes.download import STYLE, state_html
from app.widgets import Listing

SHOWN: Final = 12


class ExportFilesPanel:
    """The exported files that one browser can download."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.export = gui.add_button("Export", icon=viser.Icon.DOWNLOAD)
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
