"""What a notification says of an error: what did not work as its title, and below it where, why, and what to do."""

from __future__ import annotations

from typing import Final

from app.formatting.field_words import in_control_words
from core.errors import RallyscopeError

LONGEST_TITLE: Final = 80


def notice_of(error: RallyscopeError) -> tuple[str, str]:
    """Title and text."""
    what = error.what[:1].upper() + error.what[1:]
    if len(what) > LONGEST_TITLE:
        cut = what[:LONGEST_TITLE].rpartition(" ")[0] or what[:LONGEST_TITLE]
        return f"{cut} ...", str(error)
    return what, in_control_words(error.details)
