"""The bench of slow receptors: its sensor, and what is counted."""

import math

import numpy as np
import pytest

from benchmarks.detection import bench_slow_receptors as bench


def test_a_slow_receptor_has_a_tail_and_its_first_event_marks_the_edge_better() -> None:
    flight = bench.draw_slow_flight("bright ball", 500.0, 1)
    again = bench.draw_slow_flight("bright ball", 500.0, 1)
    assert np.array_equal(flight.events.t_us, again.events.t_us)
    last, first = (bench.score_slow_flight(flight, config) for config in bench.CONFIGS.values())
    assert first.found == first.asked > 40 and not first.false and not last.false
    assert np.median(first.error_px) < 0.12 and np.median(first.error_px) < 0.6 * np.median(last.error_px)
    assert 0.0 < first.lag_ms < 0.5 * last.lag_ms


def test_a_row_counts_all_its_flights_those_without_answers_too() -> None:
    one = bench.FlightScore(10, 8, 1, 0.5, np.array([0.1, 0.3]))
    none = bench.FlightScore(10, 0, 0, math.nan, np.empty(0))
    row = bench.summarise_flights([one, none])
    assert (row["recall"], row["false"], row["median_px"], row["lag_ms"]) == (0.4, 1, pytest.approx(0.2), 0.5)
    assert math.isnan(float(str(bench.summarise_flights([none])["median_px"])))
