import numpy as np
import pytest

from benchmarks.prediction.bench_prediction import FlightTruth, PredictionErrors, PredictionSeries
from core.trajectory import HitPlane, Prediction, TablePoint

TRUTH = FlightTruth(0.30, np.array([-0.8, 0.1, 0.02]), 0.50, np.array([-1.42, 0.2, 0.3]))


def series(t_s: float, off_m: float) -> Prediction:
    p = TRUTH.hit_m + np.array([0.0, 0.6 * off_m, 0.8 * off_m])
    covariance = np.diag([0.0, 0.01, 0.01, 1, 1, 1]) ** 2
    hit = HitPlane(0.502, 0.002, p, np.full(3, 0.01), np.zeros(3), np.ones(3), covariance, "pre")
    landing = TablePoint(0.30, TRUTH.landing_m + np.array([off_m, 0.0, 0.0]), np.full(3, 0.01))
    return Prediction(round(1e6 * t_s), "pre", (), landing, hit, None)  # pyright: ignore[reportArgumentType]


def test_the_newest_prediction_at_each_moment_counts() -> None:
    errors = PredictionErrors()
    made = {0.099: 0.05, 0.21: 0.04, 0.25: 0.03, 0.331: 0.02, 0.46: 0.01}
    errors.score(PredictionSeries(list(made), [series(t, off) for t, off in made.items()]), TRUTH)
    assert errors.landing_mm == [pytest.approx(40)], "of 0.21 s: 80 ms before 0.30 s"
    assert errors.plane_mm == [pytest.approx(30)], "of 0.25 s: the next is 31 ms after the bounce"
    assert errors.time_ms == [pytest.approx(2)]
    assert errors.by_lead_mm[25] == [pytest.approx(10)] and errors.by_lead_mm[50] == [pytest.approx(20)]
    assert errors.by_lead_mm[400] == [pytest.approx(50)]
    # 1 sigma in y and z together, 1 sigma in time: (1 + 1) / 3.
    assert errors.normalised[25] == [pytest.approx((1 + 1) / 3)]


def test_a_moment_at_which_nothing_was_said_has_no_figure() -> None:
    errors = PredictionErrors()
    errors.score(PredictionSeries([0.4], [series(0.4, 0.0)]), TRUTH)
    assert errors.landing_mm == [] and errors.plane_mm == [] and errors.by_lead_mm[150] == []
    row = errors.row()
    assert row["landing_80ms_ahead_median_mm"] is None and row["landing_80ms_ahead_flights"] == 0
