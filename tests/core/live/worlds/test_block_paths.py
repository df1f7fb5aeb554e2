"""Paths between samples: exact for what is cubic, with the derivative as velocity, and the limits of a ball's life."""

import numpy as np
import pytest
from numpy.typing import NDArray

from core.live.worlds.world import SINK_S, SampledPath, SampledRacket

pytestmark = pytest.mark.numeric
Array = NDArray[np.float64]

CUBE = np.array([[0.1, -0.2, 0.3], [1.0, 0.5, -2.0], [3.0, -1.0, 4.0], [-5.0, 7.0, 2.0]])
"""Coefficients (power, axis) of a path that is no parabola."""
SPIN = np.array([10.0, 20.0, 30.0])


def p_at(t: float) -> Array:
    return np.array([1.0, t, t * t, t**3]) @ CUBE


def v_at(t: float) -> Array:
    return np.array([0.0, 1.0, 2 * t, 3 * t * t]) @ CUBE


def state(t: float) -> Array:
    return np.concatenate([p_at(t), v_at(t), SPIN])


def cubic_path() -> SampledPath:
    path = SampledPath(0.5)
    for start, end in ((0.5, 0.53), (0.53, 0.6)):
        path.add(start, state(start), end, state(end))
    return path


def test_place_and_velocity_between_samples_are_those_of_the_cubic() -> None:
    times = np.array([0.5, 0.511, 0.53, 0.54, 0.5999])
    found = cubic_path().at(times)
    np.testing.assert_allclose(found.p_world_m, [p_at(t) for t in times], atol=1e-12)
    np.testing.assert_allclose(found.v_world_mps, [v_at(t) for t in times], atol=1e-9)
    assert (found.spin_radps == SPIN).all() and found.present.all()


def test_before_its_first_sample_there_is_no_ball_and_after_the_last_it_stays() -> None:
    found = cubic_path().at([0.4999, 0.5, 0.9])
    assert found.present.tolist() == [False, True, True]
    assert np.isnan(found.p_world_m[0]).all() and np.isnan(found.spin_radps[0]).all()
    np.testing.assert_allclose(found.p_world_m[2], p_at(0.6))
    assert not SampledPath(0.0).at([0.0, 1.0]).present.any()


def test_a_ball_out_of_play_sinks_behind_a_rising_floor_and_is_gone() -> None:
    path = cubic_path()
    path.gone_s = 0.7
    assert path.at([0.7 + SINK_S - 1e-6, 0.7 + SINK_S]).present.tolist() == [True, False]
    floor = path.visible_range([0.6999, 0.7, 0.7 + SINK_S / 2, 0.7 + SINK_S])
    assert floor.offset_m[0] == -np.inf
    np.testing.assert_allclose(floor.offset_m[1:], p_at(0.6)[2] + 0.02 * np.array([-1.0, 0.0, 1.0]))
    assert (floor.normal_world[1:] == [0, 0, 1]).all()


def test_a_served_ball_comes_out_of_a_mouth_three_radii_long() -> None:
    path = cubic_path()
    path.launch = (0.5, np.array([1.0, 0.2, 0.3, -3.0, 0.0, 4.0, 0, 0, 0]))  # 5 m/s: 60 mm in 12 ms
    mouth = path.visible_range([0.4999, 0.5, 0.5119, 0.5121])
    assert np.isfinite(mouth.offset_m).tolist() == [False, True, True, False]
    np.testing.assert_allclose(mouth.normal_world[1], [-0.6, 0.0, 0.8])
    assert mouth.offset_m[1] == pytest.approx(-0.6 * 1.0 + 0.8 * 0.3 + 0.02), "a radius ahead of the launch"


def test_a_racket_between_samples_is_on_the_cubic_with_a_unit_normal() -> None:
    times = np.array([0.5, 0.53, 0.6])
    normals = np.array([[1.0, 0, 0], [0.8, 0.6, 0], [0.8, 0, 0.6]])
    racket = SampledRacket(
        times, np.array([p_at(t) for t in times]), np.array([v_at(t) for t in times]), normals, 0.08, 0.01
    )
    asked = np.array([0.5, 0.515, 0.53, 0.57, 0.6])
    found = racket.at(asked)
    np.testing.assert_allclose(found.p_world_m, [p_at(t) for t in asked], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.normal_world, axis=1), 1.0)
    np.testing.assert_allclose(found.normal_world[1], np.array([0.9, 0.3, 0]) / np.hypot(0.9, 0.3))
    np.testing.assert_allclose(racket.at([0.1, 0.9]).p_world_m, [p_at(0.5), p_at(0.6)])
