"""Who labels: a name that each browser is asked for once, before its first label."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Final

import viser

from app import theme
from app.formatting import html_text
from app.modes.label.labelling import DEFAULT_ANNOTATOR
from app.modes.mode import ModeHost
from app.shared.workspace import slug_from
from app.state.commands import SignIn
from app.widgets import when_clicked
from core.errors import CommandError
from core.files import replace_file

LONGEST_NAME: Final = 40
FILE: Final = "last-annotator.txt"


def annotator_from(text: str) -> str:
    """The name of a layer made of what a person typed: small letters, digits, - and _.

    Raises:
        CommandError: if it is empty or too long, or has characters that nobody sees.
    """
    name = text.strip()
    if len(name) > LONGEST_NAME:
        raise CommandError("too long a name", expected=f"up to {LONGEST_NAME} characters", got=len(name))
    if any(unicodedata.category(letter).startswith("C") for letter in name):
        raise CommandError("a name with characters that nobody sees", expected="letters and digits")
    return slug_from(name)


def last_annotator(labels: Path) -> str:
    """Who labelled last in this workspace: the name that others are offered."""
    with suppress(OSError, UnicodeDecodeError, CommandError):
        return annotator_from((labels / FILE).read_text(encoding="utf-8"))
    return DEFAULT_ANNOTATOR


def remember_annotator(labels: Path, name: str) -> None:
    """Offer this name to the next browser. What cannot be written is not remembered: labels will say why."""
    with suppress(OSError):
        replace_file(labels / FILE, name.encode(), durable=True)


class AnnotatorPrompt:
    """A window that asks for the name."""

    def __init__(
        self, gui: viser.GuiApi, default: str, named: Callable[[str], None], declined: Callable[[], None]
    ) -> None:
        """Exactly one of `named` and `declined` is called, from viser's loop."""
        self._modal = gui.add_modal("Who labels?")
        with self._modal:
            gui.add_markdown("Your labels are stored under your name. This window asks once.")
            self._name = gui.add_text("Your name", default)
            self._wrong = gui.add_html("")
            go = gui.add_button("Label under this name", icon=viser.Icon.CHECK, color="teal")
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


class AnnotatorSignIn:
    """Who labels in one browser. Methods are called by the loop."""

    def __init__(self, host: ModeHost, show: Callable[[str | None], None], take: Callable[[str], None]) -> None:
        """`show` puts a name into the panel's field, or back what it showed; `take` is told each name that is given."""
        self._host = host
        self._show = show
        self._take = take
        self._prompt: AnnotatorPrompt | None = None
        self.named = False
        """Whether the person has said who labels."""

    def use(self, text: str) -> None:
        """Label under the name that was typed into the panel.

        Raises:
            CommandError: if it cannot be a name.
        """
        try:
            name = annotator_from(text)
        except CommandError:
            self._show(None)
            raise
        self._sign_in(name)

    def ask(self, default: str, then: Callable[[], None]) -> None:
        """Ask for the name, and call `then` once it is given; nothing if it is being asked for."""
        if self._prompt is not None:
            return
        host = self._host

        def named(name: str) -> None:
            self._prompt = None
            self._sign_in(name)
            then()

        def declined() -> None:
            self._prompt = None

        self._prompt = AnnotatorPrompt(
            host.client.gui, default, lambda name: host.later(lambda: named(name)), lambda: host.later(declined)
        )

    def _sign_in(self, name: str) -> None:
        """From now on this browser's labels are of this annotator."""
        self.named = True
        self._host.send(SignIn(name))
        self._show(name)  # as it is stored: small letters
        self._take(name)
