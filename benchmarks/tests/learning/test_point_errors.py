"""Errors of points: what was put in is found again."""

import numpy as np
import pytest

from benchmarks.learning.point_errors import SeenFlight, fit_point_errors
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import draw_serve_batch
from core.learning.task.timed_points import MEASURED
from core.simulation.episodes.closed_form import sample_serves

pytestmark = pytest.mark.numeric
TRUTH = EnvironmentConfig(state_source="truth")


def flights(count: int, seed: int) -> list[SeenFlight]:
    balls = draw_serve_batch(5.0, count, TRUTH, np.random.default_rng(seed))
    t_s = np.arange(0.02, float(balls.arrivals.t_s.min()), 0.002)
    truth_m = sample_serves(balls.serves, balls.arrivals, np.broadcast_to(t_s, (count, len(t_s))), TRUTH.task)
    errors_m = MEASURED.draw(t_s, truth_m, balls.arrivals.bounce_t_s, np.random.default_rng(seed + 1))
    return [SeenFlight(t_s, truth_m[i], errors_m[i], float(balls.arrivals.bounce_t_s[i])) for i in range(count)]


def test_a_fit_of_drawn_errors_finds_their_scatter_again() -> None:
    found = fit_point_errors(flights(80, 1))
    total = np.sqrt(MEASURED.drift**2 + MEASURED.noise**2)
    assert np.sqrt(found.drift**2 + found.noise**2) == pytest.approx(total, rel=0.25)
    assert 0 < found.drift_s < 0.05


def test_what_place_and_motion_explain_is_alike_in_new_flights() -> None:
    fitted, fresh = fit_point_errors(flights(80, 1)), flights(40, 9)
    drawn_mm = 1e3 * np.array([one.errors_m for one in fresh])
    again_mm = 1e3 * np.array(
        [
            fitted.draw(one.t_s, one.truth_m[None], np.array([one.bounce_t_s]), np.random.default_rng(i))[0]
            for i, one in enumerate(fresh)
        ]
    )
    assert again_mm.mean(axis=(0, 1)) == pytest.approx(drawn_mm.mean(axis=(0, 1)), abs=0.06)


def test_equal_seeds_err_equally() -> None:
    one, other = flights(2, 4), flights(2, 4)
    np.testing.assert_array_equal(one[1].errors_m, other[1].errors_m)
