"""Flights of a data set are split so that nothing is on two sides, in any order of them."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from core.data_sets.cut_flights import FEWEST_RECORDINGS, SPLITS, CutFlight, split_flights, splits_by_recording


def flight(recording: int, number: int) -> CutFlight:
    return CutFlight(
        recording=f"r{recording}", recording_uuid=f"uuid-{recording}", ball=number, start_us=number * 100,
        end_us=number * 100 + 90, found_by="truth", centres_by={}, label_sources={},
    )  # fmt: skip


def test_of_few_recordings_the_flights_are_split_and_of_many_the_recordings() -> None:
    few = [flight(recording, number) for recording in range(2) for number in range(50)]
    assert not splits_by_recording(few)
    assert Counter(split_flights(few)) == {"training": 70, "validation": 15, "test": 15}
    many = [flight(recording, number) for recording in range(FEWEST_RECORDINGS) for number in range(3)]
    assert splits_by_recording(many)
    sides = {(one.recording, split) for one, split in zip(many, split_flights(many), strict=True)}
    assert len(sides) == FEWEST_RECORDINGS
    assert Counter(split for _, split in sides).keys() == set(SPLITS)


def test_the_split_of_a_flight_does_not_depend_on_the_order() -> None:
    flights = [flight(recording, number) for recording in range(3) for number in range(9)]
    splits = dict(zip([(one.recording, one.ball) for one in flights], split_flights(flights), strict=True))
    random.Random(1).shuffle(flights)
    assert [splits[one.recording, one.ball] for one in flights] == split_flights(flights)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 7])
def test_three_flights_or_more_leave_no_split_empty(count) -> None:
    splits = split_flights([flight(0, number) for number in range(count)])
    assert len(splits) == count
    if count >= len(SPLITS):
        assert set(splits) == set(SPLITS)
