"""The window that asks for the annotator's name, before the first label of a browser."""

from __future__ import annotations

from collections.abc import Callable

import viser

from app import theme
from app.formatting.file_text import html_text
from app.modes.label.first_label.annotator import annotator_from
from app.widgets import when_clicked
from core.errors import CommandError


class AnnotatorPrompt:
    """A window that asks for the name."""

    def __init__(
        self, gui: viser.GuiApi, default: str, named: Callable[[str], None], declined: Callable[[], None]
    ) -> None:
        """Exactly one of `named` and `declined` is called, from viser's loop."""
        self._modal = gui.add_modal("Who labels?")
        with self._modal:
            gui.add_markdown("Labels are kept under a name of yours. It is asked for once in this window.")
            self._name = gui.add_text("Your name", default)
            self._wrong = gui.add_html("")
            go = gui.add_button("Label under this name", icon=viser.Icon.CHECK)
            no = gui.add_button("Not now")
        self._named = named
        when_clicked(go, self._take)
        when_clicked(no, lambda: self._end(declined))

    def _take(self) -> None:
        try:
            name = annotator_from(str(self._name.value))
        except CommandError as error:
            style = f"font-size:12.5px;padding:2px 12px;color:{theme.BAD}"
            self._wrong.content = f"<div style='{style}'>{html_text(str(error))}</div>"
            return
        self._end(lambda: self._named(name))

    def _end(self, then: Callable[[], None]) -> None:
        self._modal.close()
        then()
