"""A colour tells a speed to everybody: by its lightness, and never as blue as the table."""

import numpy as np
import pytest

from app.scene.arena import TABLE_RGB
from app.scene.ball import FASTEST_MPS, SLOWEST_MPS, STOPS, resampled, speed_colours, speed_line_colours

SPEEDS = np.linspace(SLOWEST_MPS, FASTEST_MPS, 50)
DEUTERANOPE = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
PROTANOPE = np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]])
"""Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB."""


def linear(rgb) -> np.ndarray:
    share = np.asarray(rgb, np.float64) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def luminance(rgb) -> np.ndarray:
    return linear(rgb) @ [0.2126, 0.7152, 0.0722]


def test_known_speeds_have_known_colours() -> None:
    colours = speed_colours([SLOWEST_MPS, FASTEST_MPS, 0.0, 30.0, np.nan])
    slowest, fastest = STOPS[0].tolist(), STOPS[-1].tolist()
    assert colours.tolist() == [slowest, fastest, slowest, fastest, slowest]
    assert speed_colours([(SLOWEST_MPS + FASTEST_MPS) / 2])[0] == pytest.approx(STOPS[2], abs=1)


@pytest.mark.parametrize("seen_as", [np.eye(3), DEUTERANOPE, PROTANOPE])
def test_a_faster_ball_is_lighter_to_everybody(seen_as) -> None:
    light = np.clip(linear(speed_colours(SPEEDS)) @ seen_as.T, 0, 1) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light) > 0).all() and light[-1] > 3 * light[0]


@pytest.mark.parametrize("seen_as", [np.eye(3), DEUTERANOPE, PROTANOPE])
def test_no_speed_looks_like_the_table(seen_as) -> None:
    trail, table = (np.clip(linear(rgb) @ seen_as.T, 0, 1) for rgb in (speed_colours(SPEEDS), TABLE_RGB))
    assert np.abs(trail - table).max(axis=1).min() > 0.2


def test_a_line_gets_linear_light() -> None:
    np.testing.assert_allclose(speed_line_colours(SPEEDS), 255 * linear(speed_colours(SPEEDS)), atol=0.51)


def test_a_resampled_trail_keeps_its_ends_and_its_order() -> None:
    ps = np.column_stack([np.arange(7.0), np.zeros(7), np.zeros(7)])
    for points in (3, 20):
        found, speeds = resampled(ps, np.arange(7.0), points)
        assert found.shape == (points, 3) and found[0, 0] == 0 and found[-1, 0] == 6
        assert (np.diff(found[:, 0]) >= 0).all() and (speeds == found[:, 0]).all()
