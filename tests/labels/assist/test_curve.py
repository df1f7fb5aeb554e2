from __future__ import annotations

import numpy as np
import pytest

from benchmarks.labels.assistance import try_interpolation
from labels.arrays import LabelArrays, label_arrays
from labels.assist.curve import CurveConfig, find_breaks, interpolate, split_segments
from labels.model import Label, LabelState

pytestmark = pytest.mark.numeric


def along(t_us: np.ndarray, x: np.ndarray, y: np.ndarray) -> LabelArrays:
    return label_arrays(
        Label(t_us=int(t), state=LabelState.VISIBLE, x_px=float(a), y_px=float(b), r_px=5.0 + 1e-5 * float(t))
        for t, a, b in zip(t_us, x, y, strict=True)
    )


@pytest.fixture
def bounce() -> tuple[np.ndarray, LabelArrays]:
    t = np.arange(0, 200_000, 10_000)
    s = t * 1e-3
    return t, along(t, 2.0 * s + 5, np.abs(s - 103.0) * 1.5)


def test_a_cubic_path_is_reproduced_exactly() -> None:
    t = np.arange(0, 200_000, 20_000)

    def x(t: np.ndarray) -> np.ndarray:
        s = t * 1e-5
        return 100 + 30 * s + 4 * s**2 - s**3

    wanted = np.arange(0, 180_001, 1000)
    curve = interpolate(along(t, x(t), -x(t)), wanted)
    assert curve.covered.all()
    np.testing.assert_allclose(curve.x_px, x(wanted), atol=1e-6)
    np.testing.assert_allclose(curve.y_px, -x(wanted), atol=1e-6)
    np.testing.assert_allclose(curve.r_px, 5.0 + 1e-5 * wanted, atol=1e-9)


def test_a_bounce_is_found_and_not_crossed(bounce: tuple[np.ndarray, LabelArrays]) -> None:
    _, keys = bounce
    assert find_breaks(keys.t_us, np.column_stack([keys.x_px, keys.y_px])) == [10]
    wanted = np.arange(0, 190_001, 1000)
    curve = interpolate(keys, wanted)
    np.testing.assert_array_equal(wanted[~curve.covered], np.arange(101_000, 110_000, 1000))
    np.testing.assert_allclose(curve.y_px[curve.covered], np.abs(wanted * 1e-3 - 103.0)[curve.covered] * 1.5, atol=1e-6)


def test_a_break_that_a_person_marks_is_not_crossed() -> None:
    t = np.arange(0, 200_000, 10_000)
    keys = along(t, t * 1e-3, t * 1e-3)
    curve = interpolate(keys, [94_000, 95_000, 96_000, 104_000], breaks_us=[95_000])
    np.testing.assert_array_equal(curve.covered, (False, False, False, True))


@pytest.mark.parametrize("state", [LabelState.NO_BALL, LabelState.OCCLUDED, LabelState.OUT_OF_FRAME])
def test_nothing_is_made_up_while_the_ball_is_not_seen(state: LabelState) -> None:
    t = np.arange(0, 200_000, 10_000)
    labels = [Label(t_us=int(k), state=LabelState.VISIBLE, x_px=k * 1e-3, y_px=0.0) for k in t]
    keys = label_arrays([*labels, Label(t_us=95_000, state=state)])
    curve = interpolate(keys, [85_000, 92_000, 97_000, 105_000])
    np.testing.assert_array_equal(curve.covered, (True, False, False, True))
    assert np.isnan(curve.x_px[1:3]).all()


def test_ends_gaps_and_few_keyframes_are_left_alone() -> None:
    t = np.array([0, 10_000, 20_000, 30_000, 40_000, 400_000, 410_000, 420_000])
    keys = along(t, t * 1e-3, t * 1e-3)
    curve = interpolate(keys, [-5_000, 5_000, 45_000, 200_000, 405_000, 500_000])
    np.testing.assert_array_equal(curve.covered, (False, True, False, False, False, False))
    assert not interpolate(label_arrays([]), [1, 2]).covered.any()
    assert split_segments(label_arrays([])) == []


def test_scatter_of_the_keyframes_shows_in_the_uncertainty() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(0, 400_000, 10_000)
    config = CurveConfig(keyframe_sigma_px=0.05, break_sigmas=30)
    quiet = interpolate(along(t, t * 1e-3, t * 0.0), t + 5000, config=config).sigma_px[:-1]
    noisy = interpolate(
        along(t, t * 1e-3 + rng.normal(0, 0.4, 40), rng.normal(0, 0.4, 40)), t + 5000, config=config
    ).sigma_px[:-1]
    assert np.nanmedian(noisy) > 3 * np.nanmedian(quiet)


def test_the_uncertainty_in_the_middle_is_that_of_a_cubic_through_six() -> None:
    """Between the third and fourth of six even keyframes the value is their mean and curvature: its variance is
    sum(u^4) / (6 sum(u^4) - sum(u^2)^2) = 1414 / 3584 of theirs, with u = -5, -3, ..., 5.
    """
    t = np.arange(0, 60_000, 10_000)
    share = np.sqrt(1414 / 3584)
    exact = interpolate(along(t, t * 1e-3, t * 2e-3), [25_000], config=CurveConfig(keyframe_sigma_px=0.4))
    assert exact.sigma_px[0] == pytest.approx(0.4 * share)
    off = np.array([1.0, -2.0, 0.5, 1.5, -1.0, 2.0])
    config = CurveConfig(keyframe_sigma_px=0.1, break_sigmas=30)
    found = interpolate(along(t, t * 1e-3 + off, t * 2e-3 - 2 * off), [25_000], config=config)
    missed = off - np.polyval(np.polyfit(t / 3e4, off, 3), t / 3e4)
    scatter = np.sqrt((missed**2).sum() * (1 + 4) / (2 * 2))  # two coordinates, two degrees of freedom each
    assert found.sigma_px[0] == pytest.approx(scatter * share, rel=1e-6)
    middle = np.polyval(np.polyfit(t / 3e4, off, 3), 2.5e4 / 3e4)
    assert found.x_px[0] == pytest.approx(25 + middle) and found.y_px[0] == pytest.approx(50 - 2 * middle)


def test_where_a_hidden_ball_was_guessed_is_no_keyframe() -> None:
    t = np.arange(0, 200_000, 10_000)
    labels = [Label(t_us=int(k), state=LabelState.VISIBLE, x_px=k * 1e-3, y_px=0.0) for k in t]
    guessed = Label(t_us=95_000, state=LabelState.OCCLUDED, x_px=500.0, y_px=300.0)
    keys = label_arrays([*labels, guessed])
    assert sorted(np.concatenate(split_segments(keys)).tolist()) == [row for row in range(21) if row != 10]
    curve = interpolate(keys, [85_000, 92_000, 105_000])
    np.testing.assert_array_equal(curve.covered, (True, False, True))
    np.testing.assert_allclose(curve.x_px[[0, 2]], [85, 105], atol=1e-6)


def test_every_tenth_frame_labelled_gives_the_rest() -> None:
    trial = try_interpolation(2, 10, np.random.default_rng(0), sigma_px=0.4)
    assert np.median(trial.curve_px) <= 0.5 and np.percentile(trial.curve_px, 95) <= 1.5
    assert np.median(trial.flight_px) <= 0.5 and np.percentile(trial.flight_px, 95) <= 1.5
    assert np.median(trial.curve_px) < np.median(trial.linear_px)
    assert trial.curve_share > 0.9
    assert (trial.across_px < 3).all()
