"""The filter that is told nothing, on flights with spin at 140 points/s and 3 mm of noise."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robustness.bench_robustness import held_out
from core.metrics.spinning_flights import (
    MAX_SPIN_RADPS,
    NOISE_M,
    ForeseenPoints,
    foresee_flights,
    spinning_flights,
    thinned,
    touches_net,
)
from core.physics.fit_flights import RecordedFlight, simulate_flight, with_constants
from core.physics.flight_files import read_flight
from core.trajectory import FilterPredictor, filter_for

UNTOLD = replace(filter_for("paper"), perhaps_real=True)


def simulated(count: int, seed: int) -> list[RecordedFlight]:
    """Flights with up to 450 rad/s in a lab whose constants are drawn, and differ a little from ball to ball."""
    rng = np.random.default_rng(seed)
    lab = rng.normal((0.5, 0.92, 0.22), (0.06, 0.03, 0.05))
    flights: list[RecordedFlight] = []
    while len(flights) < count:
        constants = lab + rng.standard_normal(3) * (0.045, 0.025, 0.035)
        spin = rng.standard_normal(3) * (120, 220, 120)
        velocity = -rng.uniform(4, 9), rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 1.8)
        start = np.array([1.3, rng.uniform(-0.3, 0.3), rng.uniform(0.2, 0.5), *velocity, *spin])
        t_s = np.arange(0, 0.62, 1 / 179)
        ps = simulate_flight(start, t_s, with_constants(0.1, *constants.tolist()))
        if np.linalg.norm(spin) <= MAX_SPIN_RADPS and ps[:, 2].min() > 0:
            flights.append(RecordedFlight(str(len(flights)), t_s, ps))
    return flights


@pytest.mark.parametrize("seed", [1, 3])
def test_told_nothing_it_is_as_good_as_told_on_simulated_flights_and_never_surer_than_it_may_be(seed: int) -> None:
    flights = simulated(10, seed)
    untold = foresee_flights(FilterPredictor(UNTOLD), flights, recorded_noise_m=0.0)
    told = foresee_flights(FilterPredictor(filter_for("real")), flights, carry=False, recorded_noise_m=0.0)
    for ahead, found in untold.items():
        assert len(found.errors_m) > 100
        assert 0.3 < found.nees < 1.25, "careful, as real flights are not quite what the model says"
        assert found.worst_tenth_m < 1.2 * told[ahead].worst_tenth_m


@pytest.mark.parametrize("carry", [False, True])
def test_told_nothing_it_is_as_good_as_told_on_recorded_flights_that_nothing_was_tuned_on(shared_data, carry) -> None:
    files = sorted((shared_data / "trajectories" / "tt3d").glob("*.csv"))
    flights = held_out([read_flight(path) for path in files])
    assert len(flights) >= 25
    untold = foresee_flights(FilterPredictor(UNTOLD), flights, carry=carry)
    told = foresee_flights(FilterPredictor(filter_for("real")), flights, carry=False)
    wrong = foresee_flights(FilterPredictor(filter_for("paper")), flights, carry=False)
    for ahead, found in untold.items():
        assert 0.8 < found.nees < 1.25
        assert found.worst_tenth_m < 1.2 * told[ahead].worst_tenth_m
        assert found.worst_tenth_m < 0.6 * wrong[ahead].worst_tenth_m


def test_figures_of_some_predictions() -> None:
    found = ForeseenPoints(np.arange(11.0), np.array([0.5, 1.5]))
    assert (found.median_m, found.worst_tenth_m, found.nees) == (5.0, 9.0, 1.0)


def test_a_flight_is_thinned_to_140_points_a_second_with_3_mm_of_noise() -> None:
    (flight,) = simulated(1, 5)
    seen = thinned(flight, 0, 0.0)
    assert len(seen.t_s) == pytest.approx(140 * flight.t_s[-1], abs=1)
    rows = np.searchsorted(flight.t_s, seen.t_s)
    np.testing.assert_array_equal(flight.t_s[rows], seen.t_s)
    assert np.std(seen.ps_m - flight.ps_m[rows]) == pytest.approx(NOISE_M, rel=0.15)


def test_flights_that_touch_the_net_and_that_spin_too_much_are_known() -> None:
    t_s = np.arange(0, 0.3, 1 / 179)
    for z, touches in ((0.14, True), (0.20, False)):
        ps = np.column_stack([0.8 - 6 * t_s, 0 * t_s, np.full(len(t_s), z)])
        assert touches_net(RecordedFlight("", t_s, ps)) is touches
        assert not touches_net(RecordedFlight("", t_s, ps + np.array([3.0, 0, 0]))), "it does not come to the net"
    start = np.array([1.3, 0.0, 0.3, -6.0, 0.0, 0.5, 0.0, 200.0, 0.0])
    flights = []
    for spin in (200.0, 900.0):
        start[7] = spin
        ps = simulate_flight(start, t_s, with_constants(0.1, 0.554, 0.945, 0.227))
        flights.append(RecordedFlight(str(spin), t_s, ps))
    assert [flight.name for flight in spinning_flights(flights)] == ["200.0"]
