"""Selected rows become flights, each once, and their centres are those of a person, else of the truth."""

from __future__ import annotations

import numpy as np
import pytest

from core.recordings.truth import PixelTruth
from labels.arrays import LabelArrays, label_arrays
from labels.balls.flights import NO_END, NO_FLIGHT, Flight, centres_in, flights_of, truth_of_labels
from labels.balls.rows import BallRow
from labels.balls.table import table_of
from labels.model import Label, LabelState, PositionSource, Provenance

ROWS = table_of(
    [
        BallRow(kind="stroke", number=1, t_us=1_000, method="truth"),
        BallRow(kind="flight", number=1, t_us=1_000, end_us=9_000, speed_mps=5.0, method="truth"),
        BallRow(kind="bounce", number=1, t_us=4_000, method="truth"),
        BallRow(kind="stroke", number=1, t_us=9_000, method="truth"),
        BallRow(kind="flight", number=1, t_us=9_000, end_us=15_000, method="truth"),
        BallRow(kind="bounce", number=1, t_us=17_000, method="truth"),
        BallRow(kind="flight", number=2, t_us=20_000, method="episode"),
        BallRow(kind="flight", number=3, t_us=30_000, end_us=50_000, method="prediction"),
        BallRow(kind="flight", number=4, t_us=40_000, end_us=60_000, method="prediction"),
    ]
)
FLIGHT = Flight(number=1, ball=1, start_us=0, end_us=100_000, method="truth", speed_mps=None, contacts_us=())


def labels_at(*times_us: int, source: PositionSource = PositionSource.BY_HAND) -> LabelArrays:
    made = Provenance(source=source)
    return label_arrays(
        Label(t_us=t, state=LabelState.VISIBLE, x_px=t / 1000, y_px=2.0, r_px=None, provenance=made) for t in times_us
    )


def truth_at(*times_us: int) -> PixelTruth:
    t_us = np.array(times_us, np.int64)
    return PixelTruth(t_us, t_us / 1000, t_us / 1000, np.ones(len(t_us)), np.ones(len(t_us), np.bool_))


@pytest.mark.parametrize(
    ("chosen", "spans"),
    [
        ((1,), [(1, 1_000, 9_000)]),
        ((0, 1, 2), [(1, 1_000, 9_000)]),
        ((3,), [(2, 9_000, 15_000)]),
        ((8, 7), [(4, 30_000, 40_000), (5, 40_000, 60_000)]),
        ((), []),
    ],
    ids=["itself", "once", "a stroke begins it", "until the next one", "nothing"],
)
def test_chosen_rows_stand_for_their_flights(chosen, spans) -> None:
    flights, left_out = flights_of(ROWS, chosen)
    assert [(one.number, one.start_us, one.end_us) for one in flights] == spans
    assert not left_out


def test_what_has_no_flight_or_no_end_is_counted() -> None:
    flights, left_out = flights_of(ROWS, (5, 6, 6))
    assert flights == []
    assert left_out == {NO_FLIGHT: 1, NO_END: 1}


def test_a_flight_knows_the_contacts_within_it() -> None:
    (flight,), _ = flights_of(ROWS, (1,), contacts_us=(7_000, 12_000))
    assert flight.contacts_us == (4_000, 7_000)


def test_labels_of_a_person_count_before_the_truth_and_say_how_they_came_about() -> None:
    recorded = truth_at(0, 500)
    found = centres_in(
        FLIGHT, recorded, {"ann": labels_at(10, 20, source=PositionSource.ACCEPTED), "bea": labels_at(30)}
    )
    assert found is not None
    assert (found.who, found.label_sources, found.unused) == ("labels of ann", {"accepted": 2}, 1)
    assert found.truth.t_us.tolist() == [10, 20]
    outside = centres_in(FLIGHT, recorded, {"ann": labels_at(100_000)})
    assert outside is not None and outside.who == "truth" and outside.truth is recorded


def test_without_a_seen_ball_nobody_says_where_it_is() -> None:
    hidden = label_arrays([Label(t_us=10, state=LabelState.OCCLUDED)])
    assert centres_in(FLIGHT, truth_at(200_000), {"ann": hidden}) is None
    assert centres_in(FLIGHT, None, {}) is None


def test_between_labels_there_is_a_line_but_not_over_a_gap_a_contact_or_a_hidden_ball() -> None:
    labels = labels_at(0, 10_000, 40_000, 50_000, 60_000).changed(
        60_000, Label(t_us=60_000, state=LabelState.OCCLUDED, x_px=60.0, y_px=2.0)
    )
    truth = truth_of_labels(labels, contacts_us=(44_000, 50_000, 99_000))
    at = truth.at([5_000, 25_000, 30_000, 42_000, 47_000, 50_000, 55_000, 60_000])
    assert at.visible.tolist() == [True, False, False, False, False, True, False, False]
    assert at.u_px[0] == pytest.approx(5.0)
    assert (np.diff(truth.t_us) > 0).all()
    assert len(truth_of_labels(labels_at(), (5,)).t_us) == 0
