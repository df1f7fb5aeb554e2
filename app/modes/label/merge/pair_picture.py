"""Two people's labels of one time in one picture: a colour for each, and words that say whose and what. Pure."""

from __future__ import annotations

import math
from typing import Final

from app.modes.label.label_picture import CircleMark, Mark
from app.pictures.palette import PaletteIndex
from core.text.plain_text import plain
from labels.model import Label

LONGEST_NAME: Final = 40
LARGEST_PX: Final = 4_000.0
"""Of a circle that is drawn; another program's file may say anything."""


def pair_marks(mine: Label | None, theirs: Label | None) -> tuple[Mark, ...]:
    """Both circles; a label without a position has none."""
    return tuple(
        mark for label, ink in ((mine, PaletteIndex.MINE), (theirs, PaletteIndex.THEIRS)) for mark in _marks(label, ink)
    )


def pair_legend(
    mine: tuple[str, Label | None], theirs: tuple[str, Label | None]
) -> tuple[tuple[str, PaletteIndex], tuple[str, PaletteIndex]]:
    """A line for each annotator, with the colour of the circle."""
    return (f"{short_name(mine[0])}: {label_words(mine[1])}", PaletteIndex.MINE), (
        f"{short_name(theirs[0])}: {label_words(theirs[1])}",
        PaletteIndex.THEIRS,
    )


def label_words(label: Label | None) -> str:
    """State and radius."""
    if label is None:
        return "unchecked"
    state = label.state.replace("_", " ")
    if label.x_px is None:
        return state
    return f"{state}, radius not known" if label.r_px is None else f"{state}, r {label.r_px:.2f} px"


def apart_px(mine: Label | None, theirs: Label | None) -> float | None:
    """Between both centres; None unless both have one."""
    if mine is None or theirs is None or mine.x_px is None or theirs.x_px is None:
        return None
    assert mine.y_px is not None and theirs.y_px is not None
    return math.dist((mine.x_px, mine.y_px), (theirs.x_px, theirs.y_px))


def short_name(annotator: str) -> str:
    """On one line, without what nobody sees."""
    return plain(annotator, LONGEST_NAME)


def _marks(label: Label | None, ink: PaletteIndex) -> tuple[Mark, ...]:
    if label is None or label.x_px is None or label.y_px is None:
        return ()
    radius = None if label.r_px is None else min(label.r_px, LARGEST_PX)
    return (CircleMark(label.x_px, label.y_px, radius, ink),)
