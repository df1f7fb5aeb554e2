"""One's own labels of a camera beside somebody else's: where they differ, and what is resolved. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.modes.label.label_picture import CircleMark, Mark
from app.pictures.palette import PaletteIndex
from core.text import plain
from labels.arrays import SOURCES, LabelArrays
from labels.conflicts import compare_layers, settled_by
from labels.model import ContactLabel, Label, PositionSource

_RESOLVED = SOURCES.index(PositionSource.SETTLED)


@dataclass(frozen=True, slots=True, eq=False)
class LabelsOf:
    """The labels of one annotator for one camera, and the contacts: a snapshot."""

    annotator: str
    labels: Mapping[int, Label]
    """By time."""
    arrays: LabelArrays
    contacts: tuple[ContactLabel, ...] = ()
    """Bounces, hits and net touches of all cameras' layers, by time."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelComparison:
    """What is mine and what is theirs. Times ascend; all of them are inside the recording."""

    camera: str
    title: str
    """What the other's labels are called in the list that they were chosen from."""
    mine: LabelsOf
    theirs: LabelsOf
    agreed: int
    """Times at which both say the same, and nobody had to resolve anything."""
    open_us: NDArray[np.int64]
    """Conflicts."""
    resolved_us: NDArray[np.int64]
    """Times at which there was one."""
    only_mine: int
    only_theirs_us: NDArray[np.int64]

    def differs(self, t_us: int) -> bool:
        """Whether there is a conflict at a time, or was one until it was resolved."""
        return _holds(self.open_us, t_us) or _holds(self.resolved_us, t_us)

    def theirs_beside(self, t_us: int, mine: Label | None) -> Label | None:
        """The other's label where it is to be seen beside one's own: in conflicts, and where one has none."""
        return self.theirs.labels.get(t_us) if mine is None or self.differs(t_us) else None

    def next_open(self, t_us: int, step: int) -> int | None:
        """The next conflict behind a time (+1) or the one before it (-1); goes round once. None if none is open."""
        times = self.open_us
        if not len(times):
            return None
        row = int(np.searchsorted(times, t_us, side="right")) if step > 0 else int(np.searchsorted(times, t_us)) - 1
        return int(times[row % len(times)])

    def resolved_at(self, t_us: int) -> LabelComparison:
        """The same with the conflict at a time resolved: what is being saved, before it is compared anew."""
        if not _holds(self.open_us, t_us):
            return self
        left = self.open_us[self.open_us != t_us]
        return replace(self, open_us=left, resolved_us=np.sort(np.append(self.resolved_us, t_us)))


def compare_labels(camera: str, title: str, mine: LabelsOf, theirs: LabelsOf, duration_us: int) -> LabelComparison:
    """Hold two layers beside each other. Settled is what either of them says that it was settled over."""
    theirs = replace(theirs, arrays=theirs.arrays.between(0, duration_us))  # another file may say anything
    found = compare_layers(mine.arrays, theirs.arrays)
    made_to_resolve = (_sources(mine, found.common_us) == _RESOLVED) | (_sources(theirs, found.common_us) == _RESOLVED)
    names = mine.annotator, theirs.annotator
    settled = np.zeros(len(found.common_us), np.bool_)
    for row in np.flatnonzero(made_to_resolve).tolist():
        t_us = int(found.common_us[row])
        one, other = mine.labels.get(t_us), theirs.labels.get(t_us)
        settled[row] = one is not None and other is not None and settled_by(names, (one, other)) is not None
    return LabelComparison(
        camera,
        title,
        mine,
        theirs,
        agreed=int((~found.differ & ~settled).sum()),
        open_us=found.common_us[found.differ & ~settled],
        resolved_us=found.common_us[settled],
        only_mine=len(mine.arrays) - len(found.common_us),
        only_theirs_us=np.setdiff1d(theirs.arrays.t_us, found.common_us, assume_unique=True),
    )


def _sources(side: LabelsOf, t_us: NDArray[np.int64]) -> NDArray[np.uint8]:
    return side.arrays.source[np.searchsorted(side.arrays.t_us, t_us)]


def _holds(times: NDArray[np.int64], t_us: int) -> bool:
    row = int(np.searchsorted(times, t_us))
    return row < len(times) and bool(times[row] == t_us)


LONGEST_NAME: Final = 40
LARGEST_PX: Final = 4_000.0
"""Largest radius of a circle that is drawn; another program's file may say anything."""


def pair_marks(mine: Label | None, theirs: Label | None) -> tuple[Mark, ...]:
    """Both circles; a label without a position has none."""
    return tuple(
        mark
        for label, ink in ((mine, PaletteIndex.MINE), (theirs, PaletteIndex.THEIRS))
        for mark in _circle(label, ink)
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


def _circle(label: Label | None, ink: PaletteIndex) -> tuple[Mark, ...]:
    if label is None or label.x_px is None or label.y_px is None:
        return ()
    radius = None if label.r_px is None else min(label.r_px, LARGEST_PX)
    return (CircleMark(label.x_px, label.y_px, radius, ink),)
