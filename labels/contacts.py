"""Contacts of two kinds of origin held against each other: two annotators, or labels and the truth.

Two contacts are of one event if their times differ by less than the limit; each belongs to one event at most, the
nearest pairs first. Kinds do not decide that: a bounce that somebody else calls a hit is the same event.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.recordings.truth import LARGEST_GAP_US, BallTruth
from core.table import (
    BALL_RADIUS_M,
    NET_HEIGHT_M,
    NET_OVERHANG_M,
    TABLE_HEIGHT_M,
    TABLE_LENGTH_M,
    TABLE_WIDTH_M,
)
from labels.model import ContactKind, ContactLabel, PositionSource, Provenance

Array = NDArray[np.float64]
MATCH_US: Final = 10_000
"""Contacts nearer than this are of one event: the ball cannot touch table and racket so soon after each other."""
WITHIN_US: Final = 2_000
"""Two annotators whose times of one event differ by more are in conflict: a window of Label, its default."""
LEAST_JUMP_MPS: Final = 0.4
"""A change of velocity that gravity and drag do not make between two samples."""
NEAR_M: Final = 0.015
"""A contact this near to a surface is one with it: twice the depth that simulated contacts reach, and rounding."""


def match_contacts(
    first: Sequence[ContactLabel], second: Sequence[ContactLabel], within_us: int = MATCH_US
) -> tuple[tuple[int, int], ...]:
    """Pairs (row of the first, row of the second) that are of one event, by time of the first."""
    t_1, t_2 = (np.array([one.t_us for one in side], np.int64) for side in (first, second))
    order = np.argsort(t_2, kind="stable")
    low, high = np.searchsorted(t_2[order], (t_1 - within_us, t_1 + within_us + 1))
    near = [(abs(int(t_2[b] - t_1[a])), a, b) for a in range(len(t_1)) for b in order[low[a] : high[a]].tolist()]
    taken_1: set[int] = set()
    taken_2: set[int] = set()
    pairs = []
    for _, a, b in sorted(near):
        if a not in taken_1 and b not in taken_2:
            taken_1.add(a)
            taken_2.add(b)
            pairs.append((a, b))
    return tuple(sorted(pairs, key=lambda pair: (t_1[pair[0]], pair)))


def new_contacts(
    found: Sequence[ContactLabel], known: Sequence[ContactLabel], *, replace: bool = False
) -> tuple[ContactLabel, ...]:
    """Contacts of `found` that are no event of `known`; to `replace`, all that are not known exactly so."""
    if replace:
        return tuple(contact for contact in found if contact not in known)
    there = {row for row, _ in match_contacts(found, known)}
    return tuple(contact for row, contact in enumerate(found) if row not in there)


def join_contacts(first: Sequence[ContactLabel], second: Sequence[ContactLabel]) -> tuple[ContactLabel, ...]:
    """Contacts of both, by time; of an event that both have, the first's."""
    return tuple(sorted((*first, *new_contacts(second, first)), key=lambda contact: contact.t_us))


@dataclass(frozen=True, slots=True)
class TimeDifference:
    """Times of the second minus those of the first. Statistics of nothing are nan."""

    pairs: int
    median_us: float
    """Median of the absolute difference; `p95_us` is its 95th percentile."""
    p95_us: float
    bias_us: float
    """Median of the difference with its sign."""


@dataclass(frozen=True, slots=True)
class ContactAgreement:
    """How far two agree about contacts."""

    common: int
    """Events that both have."""
    only_first: int
    only_second: int
    same_kind: int
    time: TimeDifference
    by_kind: Mapping[str, TimeDifference]
    """Time differences of the events that both call by this kind; kinds without any are left out."""
    confusion: Mapping[str, Mapping[str, int]]
    """[kind of the first][kind of the second] counts of the common events."""


@dataclass(frozen=True, slots=True)
class ContactScore:
    """Contacts of one kind, or of all, against a reference. Ratios and statistics of nothing are nan."""

    kind: str
    """`all`, where the kind need not be right, or a kind, where it has to be."""
    found: int
    reference: int
    matched: int
    precision: float
    recall: float
    time: TimeDifference
    """Found minus reference."""


def measure_contact_agreement(
    first: Sequence[ContactLabel], second: Sequence[ContactLabel], within_us: int = MATCH_US
) -> ContactAgreement:
    """Compare what two say of one recording."""
    pairs = [(first[a], second[b]) for a, b in match_contacts(first, second, within_us)]
    confusion = {
        str(one): {str(other): sum((a.kind, b.kind) == (one, other) for a, b in pairs) for other in ContactKind}
        for one in ContactKind
    }
    same = {kind: [(a, b) for a, b in pairs if a.kind is b.kind is kind] for kind in ContactKind}
    return ContactAgreement(
        common=len(pairs),
        only_first=len(first) - len(pairs),
        only_second=len(second) - len(pairs),
        same_kind=sum(map(len, same.values())),
        time=_difference(pairs),
        by_kind={str(kind): _difference(those) for kind, those in same.items() if those},
        confusion=confusion,
    )


def score_contacts(
    found: Sequence[ContactLabel], reference: Sequence[ContactLabel], within_us: int = MATCH_US
) -> tuple[ContactScore, ...]:
    """Precision, recall and time error: of all contacts, then of each kind that either side has."""
    scores = [_score("all", found, reference, within_us)]
    for kind in ContactKind:
        own, real = ([one for one in side if one.kind is kind] for side in (found, reference))
        if own or real:
            scores.append(_score(str(kind), own, real, within_us))
    return tuple(scores)


def _score(name: str, found: Sequence[ContactLabel], reference: Sequence[ContactLabel], within_us: int) -> ContactScore:
    pairs = [(reference[b], found[a]) for a, b in match_contacts(found, reference, within_us)]
    nan = float("nan")
    return ContactScore(
        kind=name,
        found=len(found),
        reference=len(reference),
        matched=len(pairs),
        precision=len(pairs) / len(found) if found else nan,
        recall=len(pairs) / len(reference) if reference else nan,
        time=_difference(pairs),
    )


def _difference(pairs: Sequence[tuple[ContactLabel, ContactLabel]]) -> TimeDifference:
    if not pairs:
        return TimeDifference(0, float("nan"), float("nan"), float("nan"))
    late_us = np.array([second.t_us - first.t_us for first, second in pairs], np.float64)
    away_us = np.abs(late_us)
    return TimeDifference(
        len(pairs), float(np.median(away_us)), float(np.percentile(away_us, 95)), float(np.median(late_us))
    )


def kind_at(p_world_m: Array, v_before_mps: Array, v_after_mps: Array) -> ContactKind | None:
    """What a ball touches whose velocity jumps at a place (3,) of the world; None: the floor, or the table's end.

    A racket is what is left where there is neither table nor net.
    """
    x, y, z = (float(value) for value in p_world_m)
    over_table = abs(x) <= TABLE_LENGTH_M / 2 + NEAR_M and abs(y) <= TABLE_WIDTH_M / 2 + NEAR_M
    jump = v_after_mps - v_before_mps
    rises = float(jump[2]) > 0 and abs(float(jump[2])) >= 0.5 * float(np.linalg.norm(jump))
    if over_table and abs(z - BALL_RADIUS_M) < NEAR_M and rises:
        return ContactKind.BOUNCE
    beside_net = abs(x) < BALL_RADIUS_M + NEAR_M and abs(y) < TABLE_WIDTH_M / 2 + NET_OVERHANG_M + BALL_RADIUS_M
    if beside_net and 0 < z < NET_HEIGHT_M + BALL_RADIUS_M + NEAR_M:
        return ContactKind.NET
    on_floor = z < BALL_RADIUS_M + NEAR_M - TABLE_HEIGHT_M
    beside_end = abs(abs(x) - TABLE_LENGTH_M / 2) < BALL_RADIUS_M + NEAR_M and abs(y) < TABLE_WIDTH_M / 2
    at_end = beside_end and -TABLE_HEIGHT_M < z < 0
    return None if on_floor or at_end else ContactKind.HIT


def contacts_of_truth(ball: BallTruth) -> tuple[ContactLabel, ...]:
    """Contacts in the true path of a ball, by time, each to a microsecond or so where its samples are exact.

    The time is where the straight lines through the samples before and after a jump of the velocity meet.
    """
    t_us, v, p = ball.t_us, ball.v_world_mps, ball.p_world_m
    if len(t_us) < 2:
        return ()
    known = ball.visible & np.isfinite(v).all(axis=1) & np.isfinite(p).all(axis=1)
    joined = known[:-1] & known[1:] & (np.diff(t_us) <= LARGEST_GAP_US)
    jump = np.linalg.norm(np.diff(v, axis=0), axis=1)
    made = Provenance(source=PositionSource.IMPORTED, annotator="ground truth")
    found = []
    for row in np.flatnonzero(joined & (jump > LEAST_JUMP_MPS)).tolist():
        took_s = (t_us[row + 1] - t_us[row]) * 1e-6
        turn = v[row] - v[row + 1]
        after_s = float(np.clip((p[row + 1] - p[row] - v[row + 1] * took_s) @ turn / (turn @ turn), 0.0, took_s))
        kind = kind_at(p[row] + v[row] * after_s, v[row], v[row + 1])
        if kind is not None:
            found.append(ContactLabel(t_us=int(t_us[row]) + round(1e6 * after_s), kind=kind, provenance=made))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class ContactConflict:
    """Two annotators who say different things about one contact in one camera."""

    camera: str
    annotators: tuple[str, str]
    times_us: tuple[int, int]
    kinds: tuple[str, str]


def find_contact_conflicts(
    camera: str,
    annotators: tuple[str, str],
    contacts: tuple[Sequence[ContactLabel], Sequence[ContactLabel]],
    within_us: int = WITHIN_US,
) -> tuple[ContactConflict, ...]:
    """Events that both have, with other kinds or times farther apart; by time."""
    pairs = ((contacts[0][a], contacts[1][b]) for a, b in match_contacts(*contacts, max(MATCH_US, within_us)))
    return tuple(
        ContactConflict(camera, annotators, (one.t_us, other.t_us), (str(one.kind), str(other.kind)))
        for one, other in pairs
        if contacts_differ(one, other, within_us)
    )


def contacts_differ(one: ContactLabel, other: ContactLabel, within_us: int = WITHIN_US) -> bool:
    """Whether two of one event are in conflict: of other kinds, or times farther apart."""
    return one.kind is not other.kind or abs(one.t_us - other.t_us) > within_us
