"""Rows of figures as text for a terminal, and as JSON for a program."""

from __future__ import annotations

import math
from collections.abc import Mapping

from core.text import plain


def format_table(rows: list[dict[str, object]]) -> str:
    """Rows with the same keys as text, numbers to the right and to three decimals."""
    if not rows:
        return "nothing was measured"
    cells = [list(rows[0]), *([_cell(row.get(title)) for title in rows[0]] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)) for line in cells)


def format_row(row: Mapping[str, object]) -> str:
    """A row on its own, in one line with its titles."""
    return ", ".join(f"{title} {_cell(value)}" for title, value in row.items())


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else plain(str(value))


def json_ready(value: object) -> object:
    """A copy of the value with None for every number that is not finite, which JSON cannot hold."""
    if isinstance(value, dict):
        return {key: json_ready(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_ready(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
