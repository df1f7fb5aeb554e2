"""All times that are to be labelled as one strip: what is labelled how, what is proposed, where the cursor is.

Above it is room for one line of text: it is always in sight, so it says whether everything is saved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.pictures.palette import PaletteIndex, PolarityColours
from app.pictures.png import encode_png
from app.views.mosaic import SheetText, css_colour
from labels.arrays import STATES
from labels.model import LabelState

WIDTH_PX: Final = 1280
STATUS_PX: Final = 38
"""Height of the line of text above the strip."""
STRIP_PX: Final = 36
HEIGHT_PX: Final = STATUS_PX + STRIP_PX
LETTER_PX, BETWEEN_PX = 16, 30
"""About how wide a letter, and the room between two words, is on the sheet where the window is smallest."""
PROPOSED_PX: Final = 10
"""Height of the lower part, which shows proposals."""
STATE_INKS: Final[dict[LabelState, PaletteIndex]] = {
    LabelState.VISIBLE: PaletteIndex.LABEL,
    LabelState.PARTLY_OCCLUDED: PaletteIndex.PARTLY,
    LabelState.OCCLUDED: PaletteIndex.OCCLUDED,
    LabelState.OUT_OF_FRAME: PaletteIndex.OUT_OF_FRAME,
    LabelState.NO_BALL: PaletteIndex.NO_BALL,
}


@dataclass(frozen=True, slots=True, eq=False)
class StripData:
    """What the strip shows; times ascend."""

    start_us: int
    end_us: int
    labels_us: NDArray[np.int64]
    states: NDArray[np.uint8]
    """Index into `labels.arrays.STATES`, one for each label."""
    proposed_us: NDArray[np.int64]
    breaks_us: tuple[int, ...]
    status: tuple[tuple[str, PaletteIndex], ...] = ()
    """Words of the line above, from left to right."""


def draw_strip(data: StripData, cursor_us: int, step_us: int) -> NDArray[np.uint8]:
    """(HEIGHT_PX, WIDTH_PX) palette indices; a label is as wide as the step between labels, at least a pixel."""
    whole = np.full((HEIGHT_PX, WIDTH_PX), PaletteIndex.BACKGROUND, np.uint8)
    image = whole[STATUS_PX:]
    image[:] = PaletteIndex.UNCHECKED
    inks = np.array([STATE_INKS[state] for state in STATES], np.uint8)
    _fill(image[: STRIP_PX - PROPOSED_PX], data, data.labels_us, inks[data.states], step_us)
    drafts = np.full(len(data.proposed_us), PaletteIndex.DRAFT, np.uint8)
    _fill(image[STRIP_PX - PROPOSED_PX + 2 :], data, data.proposed_us, drafts, step_us)
    for break_us in data.breaks_us:
        image[:, _column(data, break_us)] = PaletteIndex.EPIPOLAR
    at = _column(data, cursor_us)
    image[:, max(at - 1, 0) : at + 2] = PaletteIndex.CURSOR
    return whole


def status_texts(data: StripData, y_px: float, colours: PolarityColours) -> tuple[SheetText, ...]:
    """The words of the line above, whose middle is at `y_px` of the sheet, from left to right."""
    texts, x = [], 8.0
    for text, ink in data.status:
        texts.append(SheetText(x, y_px, text, css_colour(ink, colours), is_title=True))
        x += len(text) * LETTER_PX + BETWEEN_PX
    return tuple(texts)


def encode_strip(data: StripData, cursor_us: int, step_us: int, colours: PolarityColours) -> bytes:
    """The strip as a picture file."""
    return encode_png(draw_strip(data, cursor_us, step_us), colours)


def strip_time(data_start_us: int, data_end_us: int, share: float) -> int:
    """The time at a share 0..1 of the strip's width."""
    return round(data_start_us + share * (data_end_us - data_start_us))


def _column(data: StripData, t_us: int) -> int:
    span = max(data.end_us - data.start_us, 1)
    return min(max(round((t_us - data.start_us) / span * (WIDTH_PX - 1)), 0), WIDTH_PX - 1)


def _fill(
    rows: NDArray[np.uint8], data: StripData, t_us: NDArray[np.int64], inks: NDArray[np.uint8], step_us: int
) -> None:
    """Colour the columns from half a step before each time to half a step behind it; later times lie over earlier."""
    if not len(t_us):
        return
    span = max(data.end_us - data.start_us, 1)
    share = (np.stack([t_us - step_us / 2, t_us + step_us / 2]) - data.start_us) / span * (WIDTH_PX - 1)
    first, last = np.clip(np.round(share), 0, WIDTH_PX - 1).astype(np.int64)
    columns = np.arange(WIDTH_PX)
    row = np.searchsorted(first, columns, "right") - 1  # the last that begins there or before: it also ends last
    covered = (row >= 0) & (np.maximum(last, first + 1)[row] > columns)
    rows[:, covered] = inks[row[covered]]
