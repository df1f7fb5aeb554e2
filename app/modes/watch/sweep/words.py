"""How far a sweep, or pictures of a board, have come, in plain words, as HTML."""

from __future__ import annotations

from typing import Final

from app import theme
from app.formatting.file_text import html_text
from app.modes.watch.figures import coloured, figures_html
from app.state.board_guide import BoardGuide
from app.state.swept_cells import CELL_COUNT, SweptCells
from core.cameras.calibration.board_cover import emptiest_ninth, ninth_words

GOOD_SHARE: Final = 0.7
"""Of a picture; no camera sees the ball's volume in all of its picture."""


def swept_html(swept: SweptCells, cameras: tuple[str, ...]) -> str:
    """A row a camera."""
    return figures_html([(html_text(name), _row(swept.missing(name))) for name in cameras])


def board_html(guide: BoardGuide, cameras: tuple[str, ...]) -> str:
    """A row a camera: in how many pictures the board was found, and which parts it was not in."""
    rows = []
    for name in cameras:
        count = guide.pictures.get(name, 0)
        if count:
            pictures = f"{count} picture{'s' if count > 1 else ''}"
            rows.append((html_text(name), f"{pictures}, {_row(guide.cells.missing(name))}"))
        else:
            rows.append((html_text(name), coloured(theme.WARN, "not found: does it blink, wholly in the picture?")))
    return figures_html(rows)


def _row(missing: tuple[int, ...]) -> str:
    done = CELL_COUNT - len(missing)
    colour = theme.GOOD if done >= GOOD_SHARE * CELL_COUNT else theme.WARN
    said = coloured(colour, f"{done} of {CELL_COUNT} parts")
    return said if not missing else f"{said}, most is missing {ninth_words(emptiest_ninth(missing))}"
