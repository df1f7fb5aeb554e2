"""How well those who labelled a set agree: two annotators, or one with the second looks, all recordings together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from benchmarks.app.own_balls.labelled_set import LabelledLayer, OwnSet
from labels.agreement import Agreement, made_independently, measure_agreement
from labels.score import SEAM_US, joined_in_time


@dataclass(frozen=True, slots=True)
class AnnotatorPair:
    """Two that looked at the same instants."""

    first: str
    second: str
    """The same name for the blind second looks."""
    found: Agreement


def agreement_of_set(own: OwnSet) -> tuple[AnnotatorPair, ...]:
    """Every pair with a common label; labels that settle conflicts are left out, since they were made together."""
    blind = [one for one in own.layers if one.blind]
    pairs = [(first, second, own.first_looks(second)) for first, second in combinations(own.annotators, 2)]
    pairs += [(name, name, [one for one in blind if one.annotator == name]) for name in own.annotators]
    found = [AnnotatorPair(a, b, _agreement(own.first_looks(a), theirs)) for a, b, theirs in pairs]
    return tuple(pair for pair in found if pair.found.common)


def _agreement(mine: Sequence[LabelledLayer], theirs: Sequence[LabelledLayer]) -> Agreement:
    """Of the cameras that both have labelled, one after the other, each moved by the same time on both sides."""
    of_place = {(one.path, one.camera): one.labels for one in theirs}
    both = [(one.labels, of_place[one.path, one.camera]) for one in mine if (one.path, one.camera) in of_place]
    moves, end_us = [], 0
    for pair in both:
        moves.append(end_us)
        end_us += max(int(labels.t_us[-1]) for labels in pair) + SEAM_US
    sides = [[pair[side] for pair in both] for side in (0, 1)]
    first, second = (made_independently(joined_in_time(side, moves)) for side in sides)
    return measure_agreement(first, second)
