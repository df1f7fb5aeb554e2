"""Formatting of values, names and errors: units, sizes, shares, escaped HTML, notifications."""

from __future__ import annotations

import html
import itertools
import math
import re
from collections.abc import Iterable
from typing import Final

from core.errors import RallyscopeError
from core.text.plain_text import LONGEST, plain

UNITS = {"us": "µs", "ms": "ms", "px": "px", "hz": "Hz", "s": "s", "rad": "rad", "mps": "m/s", "m": "m", "deg": "°"}
FIELD_OF_A_CLASS: Final = re.compile(r"^[A-Z]\w*Config\.(\w+)")
SEVERAL_WORDS: Final = re.compile(r"\b[a-z0-9]+(?:_[a-z0-9]+)+\b")


def field_words(field: str) -> str:
    """The unit in its suffix is set apart: `eps_px` -> "eps [px]"."""
    for above, below in itertools.product(UNITS, UNITS):
        if field.endswith(f"_{above}_per_{below}"):
            return f"{field.removesuffix(f'_{above}_per_{below}').replace('_', ' ')} [{UNITS[above]}/{UNITS[below]}]"
    name, _, suffix = field.rpartition("_")
    if name and suffix in UNITS:
        return f"{name.replace('_', ' ')} [{UNITS[suffix]}]"
    return field.replace("_", " ")


def in_control_words(details: str) -> str:
    """What is said of a field of a config, `LocaliseConfig.radius_max_px; expected ...`, in the words of its control.

    Anything else stays as it is: what has underscores there may be the name of a file.
    """
    of_class = FIELD_OF_A_CLASS.match(details)
    if of_class is None:
        return details
    rest = SEVERAL_WORDS.sub(lambda found: field_words(found[0]), details[of_class.end() :])
    return f'"{field_words(of_class[1])}"{rest}'


def size_text(size: int) -> str:
    """Readable text of a number of bytes."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{max(1, round(size / 1e3))} kB"


def html_text(text: str, most: int = LONGEST) -> str:
    """One line of it, for an element or a quoted attribute; at most `most` characters are shown."""
    return html.escape(plain(text, most), quote=True)


LONGEST_TITLE: Final = 80


def note_html(text: str, colour: str) -> str:
    """A line of HTML in small letters, below a control."""
    return f"<div style='font-size:12.5px;padding:1px 12px;color:{colour}'>{text}</div>"


def table_row(cells: Iterable[object], style: str = "", *, tag: str = "td", row_style: str = "") -> str:
    """A row of a table of HTML; `style` is that of every cell."""
    return _opened("tr", row_style) + "".join(f"{_opened(tag, style)}{cell}</{tag}>" for cell in cells) + "</tr>"


def _opened(tag: str, style: str) -> str:
    return f"<{tag} style='{style}'>" if style else f"<{tag}>"


def notice_of(error: RallyscopeError) -> tuple[str, str]:
    """Title and text of a notification."""
    what = error.what[:1].upper() + error.what[1:]
    if len(what) > LONGEST_TITLE:
        cut = what[:LONGEST_TITLE].rpartition(" ")[0] or what[:LONGEST_TITLE]
        return f"{cut} ...", str(error)
    return what, in_control_words(error.details)


def percent(share: float) -> str:
    """A share 0 to 1 as a whole per cent; 259 of 260 is 99 %, as 100 % says that none is left out."""
    value = 100.0 * share
    if 0.0 < value < 1.0:
        return "1 %"
    return f"{math.floor(value + 1e-9) if value > 99.0 else round(value)} %"
