"""TOML from files: what would take a parser for ever is no TOML either."""

from __future__ import annotations

import re
import tomllib
from typing import Any, Final

MAX_CHARACTERS: Final = 1 << 20
"""A config or a calibration is a few kilobytes."""
MAX_DOTS: Final = 64
"""In one key: for a key of 50,000 parts the parser needs a minute."""


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: if it is none, too long, or nested more deeply than a parser can go.
    """
    text = text.removeprefix("\ufeff")  # editors of Windows put a byte-order mark before a text
    if len(text) > MAX_CHARACTERS:
        raise ValueError("too long")
    if any(part.count(".") > MAX_DOTS for part in re.split(r"[=,{}\[\]\n]", text)):
        raise ValueError("a key with too many parts")
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
