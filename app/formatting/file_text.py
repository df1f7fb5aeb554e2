"""Text from a file in our HTML: names, notes, messages. Nothing in it is ever markup."""

from __future__ import annotations

import html

from core.text.plain_text import LONGEST, plain


def html_text(text: str, most: int = LONGEST) -> str:
    """One line of it, for an element or a quoted attribute; at most `most` characters are shown."""
    return html.escape(plain(text, most), quote=True)
