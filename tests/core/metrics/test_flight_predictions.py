import numpy as np
import pytest

from core.metrics.flight_predictions import compare_predictors
from core.physics.fit_flights import FittedPhysics, RecordedFlight, simulate_flight, with_constants

pytestmark = pytest.mark.numeric
CONSTANTS = {"drag_coefficient": 0.5, "restitution": 0.92, "friction": 0.22, "magnus_coefficient": 0.10}


def test_the_filter_is_nearer_than_the_paper_s_rule_and_says_how_near() -> None:
    rng = np.random.default_rng(2)
    physics = with_constants(0.10, 0.5, 0.92, 0.22)
    t_s = np.arange(0.0, 0.5, 1 / 180)
    flights = []
    for number in range(8):
        start = np.array([1.2, 0, 0.3, *rng.normal((-5, 0, 1), 0.4), *rng.normal(0, 150, 3)])
        ps = simulate_flight(start, t_s, physics) + rng.normal(0, 0.001, (len(t_s), 3))
        flights.append(RecordedFlight(str(number), t_s, ps))
    fitted = FittedPhysics(**CONSTANTS, starts=np.zeros((0, 9)), rms_m=0.001, median_m=0.001)
    found = compare_predictors(flights, fitted)
    flown, paper = found["filter"], found["paper"]
    assert flown.flights == {0.1: 8, 0.2: 8, 0.3: 8} and flown.bounces == 8
    assert flown.ahead_median_mm[0.1] < 10 < paper.ahead_median_mm[0.1]
    assert flown.ahead_median_mm[0.3] < paper.ahead_median_mm[0.3]
    assert flown.normalised[0.1] < 2.0 < paper.normalised[0.3]
