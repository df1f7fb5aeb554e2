import numpy as np
import pytest

from benchmarks.perception.measure import hit_error_mm, plane_crossings
from core.recordings import BallTruth
from core.trajectory import PaperPredictor, PaperPredictorConfig


def flights(*xs: np.ndarray) -> BallTruth:
    """One flight after the other with these x, a sample every ms and 10 ms without a ball between them."""
    x = np.concatenate([np.append(one, np.full(10, np.nan)) for one in xs])
    p = np.column_stack([x, np.full(len(x), 0.1), np.full(len(x), 0.2)])
    v = np.column_stack([np.gradient(x) * 1000, np.zeros(len(x)), np.zeros(len(x))])
    return BallTruth(np.arange(len(x)) * 1000, p, np.nan_to_num(v), np.zeros_like(v), np.isfinite(x))


def test_a_ball_that_flies_through_the_plane_is_a_hit_and_one_that_comes_back_is_none() -> None:
    towards, away = np.linspace(1.0, -2.0, 301), np.linspace(-2.0, 1.0, 301)
    first, second = plane_crossings(flights(towards, away, towards), -1.425)
    assert first.t_us == 242_500 and first.p_world_m.tolist() == pytest.approx([-1.425, 0.1, 0.2])
    assert second.t_us == 2 * 311_000 + 242_500
    assert 2 * 311_000 <= second.start_us <= 2 * 311_000 + 2000, "the flight before is none of its business"
    assert plane_crossings(flights(np.linspace(1.0, -1.0, 100)), -1.42) == []


def test_what_counts_is_the_newest_prediction_of_this_flight_100_ms_before() -> None:
    (crossing,) = plane_crossings(flights(np.linspace(0.5, -2.0, 501)), -1.42)  # 5 m/s from 0.5 m
    predictor = PaperPredictor(PaperPredictorConfig())
    said = None
    for t_us in range(0, 60_000, 2000):
        said = predictor.add(t_us, np.array([0.5 - 5e-6 * t_us, 0.1, 0.5])) or said
    assert said is not None and said.hit_plane is not None
    expected = 1e3 * float(np.hypot(*(said.hit_plane.p_world_m - crossing.p_world_m)[1:]))
    late = crossing.t_us - 99_000
    assert hit_error_mm(crossing, [100_000, late], [said, None]) == pytest.approx(expected)
    assert hit_error_mm(crossing, [100_000, late - 2000], [said, None]) is None
    assert hit_error_mm(crossing, [late], [said]) is None, "it came too late"
    earlier = type(crossing)(said.t_us + 1, crossing.t_us, crossing.p_world_m)
    assert hit_error_mm(earlier, [100_000], [said]) is None, "it was said of the flight before"
