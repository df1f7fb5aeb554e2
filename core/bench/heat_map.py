"""A table of shares as a picture: SVG text, one coloured cell per pair of bins with its number in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CELL_W: Final = 76
CELL_H: Final = 40
LEFT: Final = 96
TOP: Final = 40
BOTTOM: Final = 52
LOW, HIGH = (0xF1, 0xF3, 0xF5), (0xE8, 0x59, 0x0C)
"""Colours of 0 and 1."""


def heat_map(
    title: str, x_title: str, y_title: str, x_bins: Sequence[str], y_bins: Sequence[str], shares: Array, counts: Array
) -> str:
    """The picture as an SVG document: `shares` (rows, columns) in [0, 1] with the counts they are of; 0 is empty.

    The first row is at the bottom.
    """
    width, height = LEFT + CELL_W * len(x_bins) + 20, TOP + CELL_H * len(y_bins) + BOTTOM
    bottom = TOP + CELL_H * len(y_bins)
    middle_x, middle_y = LEFT + CELL_W * len(x_bins) / 2, TOP + CELL_H * len(y_bins) / 2
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"',
        ' font-family="sans-serif" font-size="12">',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        f'<text x="{LEFT}" y="22" font-size="14" font-weight="bold" fill="#212529">{escape(title)}</text>',
        f'<text x="{middle_x}" y="{height - 12}" text-anchor="middle" fill="#495057">{escape(x_title)}</text>',
        f'<text x="16" y="{middle_y}" text-anchor="middle" transform="rotate(-90 16 {middle_y})" fill="#495057">'
        f"{escape(y_title)}</text>",
    ]
    for column, name in enumerate(x_bins):
        x = LEFT + CELL_W * (column + 0.5)
        parts.append(f'<text x="{x}" y="{bottom + 18}" text-anchor="middle" fill="#495057">{escape(name)}</text>')
    for row, name in enumerate(y_bins):
        y = bottom - CELL_H * (row + 1)
        label_y = y + CELL_H / 2 + 4
        parts.append(f'<text x="{LEFT - 8}" y="{label_y}" text-anchor="end" fill="#495057">{escape(name)}</text>')
        for column in range(len(x_bins)):
            parts += _cell(LEFT + CELL_W * column, y, float(shares[row, column]), int(counts[row, column]))
    return "\n".join([*parts, "</svg>", ""])


def _cell(x: int, y: int, share: float, count: int) -> list[str]:
    if not count:
        return [f'<rect x="{x + 1}" y="{y + 1}" width="{CELL_W - 2}" height="{CELL_H - 2}" fill="#ffffff"/>']
    colour = "#" + "".join(f"{round(low + (high - low) * share):02x}" for low, high in zip(LOW, HIGH, strict=True))
    ink, middle = "#ffffff" if share > 0.6 else "#212529", x + CELL_W / 2
    return [
        f'<rect x="{x + 1}" y="{y + 1}" width="{CELL_W - 2}" height="{CELL_H - 2}" fill="{colour}"/>',
        f'<text x="{middle}" y="{y + 18}" text-anchor="middle" fill="{ink}">{100 * share:.0f} %</text>',
        f'<text x="{middle}" y="{y + 32}" text-anchor="middle" font-size="9" fill="{ink}">of {count:,}</text>',
    ]
