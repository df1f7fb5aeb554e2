"""How far a sweep has come, in plain words, as HTML."""

from __future__ import annotations

from collections import Counter
from typing import Final

from app import theme
from app.modes.watch.figures import figures_html
from app.state.swept_cells import CELL_COUNT, SweptCells
from app.words.file_text import html_text
from core.cameras.calibration.coverage import CELLS_ACROSS, CELLS_DOWN

GOOD_SHARE: Final = 0.7
"""Of a picture; no camera sees the ball's volume in all of its picture."""
ROWS: Final = ("upper", "middle", "lower")
COLUMNS: Final = ("left", "middle", "right")


def swept_html(swept: SweptCells, cameras: tuple[str, ...]) -> str:
    """A row a camera."""
    return figures_html([(html_text(name), _row(swept.missing(name))) for name in cameras])


def _row(missing: tuple[int, ...]) -> str:
    done = CELL_COUNT - len(missing)
    colour = theme.GOOD if done >= GOOD_SHARE * CELL_COUNT else theme.WARN
    said = f"<span style='color:{colour}'>{done} of {CELL_COUNT} parts</span>"
    return said if not missing else f"{said}, most is missing {_where(missing)}"


def _where(missing: tuple[int, ...]) -> str:
    """The ninth of the picture with most missing cells."""
    parts = Counter(
        (3 * (cell // CELLS_ACROSS) // CELLS_DOWN, 3 * (cell % CELLS_ACROSS) // CELLS_ACROSS) for cell in missing
    )
    row, column = max(sorted(parts), key=lambda part: parts[part])
    if (row, column) == (1, 1):
        return "in the middle"
    return f"at the {ROWS[row]} {COLUMNS[column]}"
