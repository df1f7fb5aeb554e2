"""Who labels: a name that each browser is asked for once, before its first label."""

from __future__ import annotations

import unicodedata
from contextlib import suppress
from pathlib import Path
from typing import Final

from app.modes.label.view import DEFAULT_ANNOTATOR
from app.shared.workspace import slug_from
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
