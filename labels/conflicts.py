"""What two people say differently about one recording, and which of it one of them has settled.

Decided here for the command that merges stores and for the app. Two labels of one time differ if their states do, or
if their centres are farther apart than they may be. A label that settles a conflict says over which label of the other
it was made: once that other label is another one, the two are compared anew.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from labels.arrays import LabelArrays, label_arrays
from labels.database.folder import Layer
from labels.model import Label, PositionSource

WITHIN_PX: Final = 2.0
"""Two careful people differ by less in 95 of 100 centres."""

Settled = Literal["mine", "theirs", "mean", "new"]
"""Whose label was taken; the mean of both centres; or a label of its own."""


@dataclass(frozen=True, slots=True)
class LabelConflict:
    """Two annotators who say different things about one time of one camera."""

    camera: str
    t_us: int
    annotators: tuple[str, str]
    states: tuple[str, str]
    distance_px: float | None
    """Between the centres; None unless both have one."""
    settled_by: str | None = None
    """The one of them whose label was made to settle it."""


@dataclass(frozen=True, slots=True, eq=False)
class Differences:
    """Two layers of one camera, held beside each other."""

    common_us: NDArray[np.int64]
    """Times that both have labelled, ascending."""
    differ: NDArray[np.bool_]
    """One for each of them."""
    distance_px: NDArray[np.float64]
    """Between the centres, one for each; nan unless both have one."""


def compare_layers(one: LabelArrays, other: LabelArrays, within_px: float = WITHIN_PX) -> Differences:
    """Where two layers differ, of all the times that they share."""
    common_us, rows_1, rows_2 = np.intersect1d(one.t_us, other.t_us, assume_unique=True, return_indices=True)
    with np.errstate(over="ignore", invalid="ignore"):  # a foreign file may hold any number
        distance = np.hypot(one.x_px[rows_1] - other.x_px[rows_2], one.y_px[rows_1] - other.y_px[rows_2])
        differ = (one.state[rows_1] != other.state[rows_2]) | (distance > within_px)
    return Differences(common_us, differ, distance)


def find_conflicts(
    labels: Mapping[Layer, Mapping[int, Label]], within_px: float = WITHIN_PX
) -> tuple[LabelConflict, ...]:
    """What different annotators say differently, by camera and time. Blind repeats are nobody's word."""
    by_camera: dict[str, list[Layer]] = defaultdict(list)
    for layer in sorted((layer for layer in labels if not layer.blind), key=lambda layer: layer.annotator):
        by_camera[layer.camera].append(layer)
    arrays = {layer: label_arrays(labels[layer].values()) for layers in by_camera.values() for layer in layers}
    found: list[LabelConflict] = []
    for camera, layers in by_camera.items():
        for one, other in itertools.combinations(layers, 2):
            names, pair = (one.annotator, other.annotator), compare_layers(arrays[one], arrays[other], within_px)
            for row in np.flatnonzero(pair.differ).tolist():
                t_us, distance = int(pair.common_us[row]), float(pair.distance_px[row])
                words = labels[one][t_us], labels[other][t_us]
                states = words[0].state.value, words[1].state.value
                apart = None if np.isnan(distance) else distance
                found.append(LabelConflict(camera, t_us, names, states, apart, settled_by(names, words)))
    return tuple(sorted(found, key=lambda conflict: (conflict.camera, conflict.t_us)))


def settlement(annotator: str, label: Label, how: Settled) -> str:
    """What the provenance of a label says, in `detector`, that settles a conflict with this label of an annotator."""
    return f"{annotator} {label.provenance.made_at_us}: {how}"


def how_settled(label: Label, annotator: str, other: Label) -> Settled | None:
    """How a label settles a conflict with this label of another annotator; None: it does not."""
    made = label.provenance
    if made.source is not PositionSource.SETTLED:
        return None
    known: tuple[Settled, ...] = ("mine", "theirs", "mean", "new")
    return next((how for how in known if made.detector == settlement(annotator, other, how)), None)


def settled_by(annotators: tuple[str, str], labels: tuple[Label, Label]) -> str | None:
    """Which of two annotators has settled what they said differently about one time."""
    for mine, theirs in ((0, 1), (1, 0)):
        if how_settled(labels[mine], annotators[theirs], labels[theirs]) is not None:
            return annotators[mine]
    return None
