"""Selected balls as flights with the ball's centres: what a data set is made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from core.recordings.truth import LARGEST_GAP_US, PixelTruth
from labels.arrays import SOURCES, LabelArrays

if TYPE_CHECKING:
    import pyarrow as pa

TRUTH: Final = "truth"
NO_FLIGHT: Final = "bounces, strokes and net touches that are in no known flight"
NO_END: Final = "flights whose end is not known"
TURNS: Final = ("bounce", "net")
"""Kinds of rows at which the ball turns within a flight."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """One flight of a recording."""

    number: int
    """Place among the recording's flights, by time, from 1."""
    ball: int
    start_us: int
    """[start_us, end_us) on the recording's clock."""
    end_us: int
    method: str
    """What found it, see `BallRow.method`."""
    speed_mps: float | None
    contacts_us: tuple[int, ...]
    """Bounces and net touches within, ascending."""


def flights_of(
    rows: pa.Table, chosen: Iterable[int], contacts_us: Iterable[int] = ()
) -> tuple[list[Flight], Counter[str]]:
    """The flights that are, or hold, the chosen rows, by time, each once; and numbers of rows without one, by reason.

    Args:
        rows: all of one recording, see `table.COLUMNS`.
        chosen: numbers of rows; a bounce, a stroke or a net touch stands for its flight.
        contacts_us: labelled contacts, beside those of the rows.
    """
    found = [row for row in rows.to_pylist() if row["t_us"] is not None]
    flights = sorted((row for row in found if row["kind"] == "flight"), key=lambda row: row["t_us"])
    turns = sorted({*contacts_us, *(row["t_us"] for row in found if row["kind"] in TURNS)})
    starts = np.array([row["t_us"] for row in flights], np.int64)
    left_out: Counter[str] = Counter()
    taken: set[int] = set()
    endless: set[int] = set()
    for t_us in (rows.column("t_us")[row].as_py() for row in chosen):
        at = -1 if t_us is None else int(np.searchsorted(starts, t_us, side="right")) - 1
        end_us = flights[at]["end_us"] if at >= 0 else None
        if at >= 0 and end_us is None:
            endless.add(at)
        elif end_us is None or t_us > end_us:
            left_out[NO_FLIGHT] += 1
        else:
            taken.add(at)
    if endless:
        left_out[NO_END] = len(endless)
    cut = []
    for at in sorted(taken):
        row, start_us = flights[at], int(starts[at])
        # A predicted flight lasts until its expected hit, which may be after the next one's start.
        end_us = min([row["end_us"], *starts[at + 1 : at + 2].tolist()])
        within = tuple(t for t in turns if start_us < t < end_us)
        cut.append(
            Flight(
                number=at + 1, ball=row["number"], start_us=start_us, end_us=end_us, method=row["method"],
                speed_mps=row["speed_mps"], contacts_us=within,
            )
        )  # fmt: skip
    return cut, left_out


@dataclass(frozen=True, slots=True, eq=False)
class FlightCentres:
    """Where the ball is in a camera during a flight, and who says so."""

    truth: PixelTruth
    who: str
    """`truth`, or `labels of NAME`."""
    label_sources: Mapping[str, int]
    """Number of labels of the ball, by `PositionSource`."""
    unused: int = 0
    """Labels of the ball of other annotators."""


def centres_in(
    flight: Flight, recorded: PixelTruth | None, labels: Mapping[str, LabelArrays], recorded_by: str = TRUTH
) -> FlightCentres | None:
    """The labels of a person where there are any of the ball, else the recording's truth; None: there is neither.

    Of several annotators the one with the most labels of the ball in this flight counts: mixed labels would jump
    between their habits.

    Args:
        flight: of a recording.
        recorded: truth of the camera.
        labels: of the camera, by annotator.
        recorded_by: whose the recorded truth is.
    """
    parts = {who: one.between(flight.start_us, flight.end_us) for who, one in sorted(labels.items())}
    counts = {who: int(part.seen.sum()) for who, part in parts.items()}
    best = max(counts, key=lambda who: counts[who], default="")
    if counts.get(best):
        used = parts[best]
        sources = Counter(str(SOURCES[one]) for one in used.source[used.seen].tolist())
        unused = sum(counts.values()) - counts[best]
        return FlightCentres(truth_of_labels(used, flight.contacts_us), f"labels of {best}", sources, unused)
    if recorded is not None:
        rows = (recorded.t_us >= flight.start_us) & (recorded.t_us < flight.end_us)
        if bool(recorded.visible[rows].any()):
            return FlightCentres(recorded, recorded_by, {})
    return None


def truth_of_labels(labels: LabelArrays, contacts_us: Iterable[int] = ()) -> PixelTruth:
    """Labels as samples of the truth: the ball is visible where it was seen.

    `PixelTruth.at` draws a line from one sample to the next. Where that would be none of the ball's path, a sample
    between them says that the ball is not visible: over more than `LARGEST_GAP_US` (within it gravity bends the path by
    0.5 mm at most), and at a contact.

    Args:
        labels: of one camera.
        contacts_us: times at which the ball turns.
    """
    t_us = labels.t_us
    before, after = t_us[:-1], t_us[1:]
    breaks = [(before + (after - before) // 2)[after - before > LARGEST_GAP_US]]
    turns = np.unique(np.array([*contacts_us], np.int64))
    if len(t_us):
        breaks.append(turns[(turns > t_us[0]) & (turns < t_us[-1]) & ~np.isin(turns, t_us)])
    extra = np.setdiff1d(np.concatenate(breaks), t_us)
    order = np.argsort(np.concatenate((t_us, extra)), kind="stable")

    def column(values: NDArray, unknown: float) -> NDArray:
        return np.concatenate((values, np.full(len(extra), unknown, values.dtype)))[order]

    seen = labels.seen
    x, y, r = (column(np.where(seen, one, np.nan), np.nan) for one in (labels.x_px, labels.y_px, labels.r_px))
    return PixelTruth(np.concatenate((t_us, extra))[order], x, y, r, column(seen, False))
