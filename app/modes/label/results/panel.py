"""The controls for what labels are good for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import viser

from app import theme
from app.formatting.file_text import html_text
from app.widgets import titles_of, when_clicked
from labels.formats import FORMATS

STYLE: Final = "padding:2px 12px;font-size:12.5px;line-height:1.45"


class LabelResultsPanel:
    """Of one browser."""

    def __init__(
        self, gui: viser.GuiApi, score: Callable[[], None], export: Callable[[], None], cancel: Callable[[], None]
    ) -> None:
        self._titles = titles_of({name: kind.label for name, kind in FORMATS.items()})
        with gui.add_folder("With these labels"):
            scoring = gui.add_button(
                "Score the detector", icon=viser.Icon.TARGET, hint="Tune's method and config against your labels here"
            )
            self._format = gui.add_dropdown("Format", tuple(self._titles.values()))
            self._pictures = gui.add_checkbox(
                "With pictures", False, hint="A PNG of the events of each label; CSV has none"
            )
            self._export = gui.add_button("Export labels", icon=viser.Icon.DOWNLOAD, hint="One ZIP file, downloaded")
            self._cancel = gui.add_button("Cancel", icon=viser.Icon.X, visible=False)
            self._status = gui.add_html("")
        when_clicked(scoring, score)
        when_clicked(self._export, export)
        when_clicked(self._cancel, cancel)

    @property
    def format(self) -> str:
        """Name of the chosen format."""
        return next((name for name, title in self._titles.items() if title == self._format.value), "voc")

    @property
    def pictures(self) -> bool:
        """Whether pictures are wanted and the format has any."""
        return bool(self._pictures.value) and FORMATS[self.format].pictures

    def show(self, lines: tuple[str, ...], *, running: bool, failed: bool) -> None:
        """How the export goes, or how it ended."""
        self._export.visible, self._cancel.visible = not running, running
        colour = theme.BAD if failed else theme.MUTED
        text = "<br>".join(html_text(line) for line in lines)
        content = f"<div style='{STYLE};color:{colour}'>{text}</div>" if lines else ""
        if self._status.content != content:
            self._status.content = content
