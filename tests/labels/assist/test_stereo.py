from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.labels.assistance import try_stereo_flags
from core.cameras import Camera, ball_circles, stereo_preset
from core.events import SensorSize
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from labels.arrays import label_arrays
from labels.assist.curve import NOT_COVERED
from labels.assist.flight import FittedFlight, curve_of_flight, fit_flight
from labels.assist.stereo import check_stereo, epipolar_curve, radius_is_off
from labels.model import Label, LabelState

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset("side")
LEFT, RIGHT = CAMERAS["left"], CAMERAS["right"]
POINTS = np.random.default_rng(0).uniform((-1.2, -0.7, 0.02), (0.5, 0.7, 0.5), (40, 3))


def test_the_curve_passes_through_the_ball_in_the_other_camera() -> None:
    for point in POINTS:
        there = RIGHT.project(point)[0]
        if np.isnan(there).any():
            continue
        curve = epipolar_curve(LEFT, LEFT.project(point)[0], RIGHT)
        start, step = curve[:-1], np.diff(curve, axis=0)
        share = ((there - start) * step).sum(axis=1) / (step**2).sum(axis=1)
        assert np.linalg.norm(start + np.clip(share, 0, 1)[:, None] * step - there, axis=1).min() < 0.1


def test_the_curve_is_bent_by_distortion() -> None:
    curve = epipolar_curve(LEFT, (200.0, 150.0), RIGHT)
    ends = curve[-1] - curve[0]
    off = np.abs(np.cross(np.append(ends, 0), np.column_stack([curve - curve[0], np.zeros(len(curve))]))[:, 2])
    assert (off / np.linalg.norm(ends)).max() > 0.5


def test_a_ray_that_the_other_camera_cannot_see_gives_an_empty_curve() -> None:
    assert epipolar_curve(LEFT, (np.nan, 0.0), RIGHT).shape == (0, 2)


def test_true_pairs_leave_no_residual_and_lead_to_the_point() -> None:
    check = check_stereo(LEFT, LEFT.project(POINTS), RIGHT, RIGHT.project(POINTS))
    np.testing.assert_allclose(check.p_world_m, POINTS, atol=1e-6)
    np.testing.assert_allclose(check.residual_px, 0, atol=1e-4)
    expected = ball_circles(LEFT, POINTS).r_px
    np.testing.assert_allclose(check.expected_r_px[:, 0], expected, rtol=1e-6)


@pytest.mark.parametrize("p", [(0.0, 0.0, 2.0), (1.1, 0.0, 1.6), (-0.9, 0.5, 1.3)])
def test_the_expected_radius_is_that_of_the_circle_with_the_area_of_the_balls_ellipse(p) -> None:
    """A sphere at (x, y, z) before a lens of focal length f is an ellipse in closed form; off the axis it is larger."""
    x, y, z = p
    K = np.array([[1000.0, 0, 640], [0, 1000.0, 360], [0, 0, 1]])
    beside = np.eye(4)
    beside[0, 3] = 0.4
    cameras = [Camera(SensorSize(1280, 720), K, np.zeros(5), pose) for pose in (np.eye(4), beside)]
    first, second = cameras
    check = check_stereo(first, first.project([p]), second, second.project([p]))
    for found_px, at in zip(check.expected_r_px[0], (x, x - 0.4), strict=True):
        across = z * z - BALL_RADIUS_M**2
        long, short = BALL_RADIUS_M * np.sqrt(at * at + y * y + across) / across, BALL_RADIUS_M / np.sqrt(across)
        assert found_px == pytest.approx(1000 * np.sqrt(long * short), rel=1e-6)


def test_pairs_with_a_missing_side_are_nan() -> None:
    check = check_stereo(LEFT, [(100.0, 100.0), (np.nan, np.nan)], RIGHT, [(np.nan, np.nan), (1.0, 2.0)])
    assert np.isnan(check.residual_px).all()


def test_errors_across_the_epipolar_line_are_flagged_and_good_labels_are_not() -> None:
    trial = try_stereo_flags(2, 5.0, np.random.default_rng(1))
    assert trial.flagged >= 0.99
    assert trial.false_flags <= 0.02
    assert trial.flagged_along < 0.1  # nothing can see those: the trial says so


def labels_of(camera, t_us: np.ndarray, points: np.ndarray, off_px: np.ndarray | None = None):
    circles = ball_circles(camera, points)
    uvs = np.column_stack([circles.u_px, circles.v_px]) + (0.0 if off_px is None else off_px)
    return label_arrays(
        Label(t_us=int(t), state=LabelState.VISIBLE, x_px=float(u), y_px=float(v))
        for t, (u, v) in zip(t_us, uvs, strict=True)
    )


def test_a_flight_is_found_from_keyframes_of_both_cameras_even_at_different_times() -> None:
    t = np.arange(0, 300_000, 20_000)

    def path(t_us: np.ndarray) -> np.ndarray:
        s = t_us[:, None] * 1e-6
        return np.array([0.6, 0.2, 0.3]) + np.array([-4.5, -0.3, 1.2]) * s - np.array([0, 0, 4.905]) * s**2

    # The right camera has keyframes of its own in between, beside six common ones.
    mixed = np.union1d(t[::3], t + 7000)
    flight = fit_flight((LEFT, RIGHT), (labels_of(LEFT, t, path(t)), labels_of(RIGHT, mixed, path(mixed))))
    assert flight is not None
    wanted = np.arange(0, 280_000, 1000)
    seen = flight.seen_by(LEFT, wanted)
    truth = ball_circles(LEFT, path(wanted))
    assert np.hypot(seen[:, 0] - truth.u_px, seen[:, 1] - truth.v_px).max() < 0.5
    assert np.abs(seen[:, 2] - truth.r_px).max() < 0.1


def flown(t_s: np.ndarray, start: np.ndarray, drag_per_m: float, spin_per_s: np.ndarray) -> np.ndarray:
    """(N, 3) positions by another integrator, from the law: drag against the velocity, Magnus across it, gravity."""

    def rates(_: float, s: np.ndarray) -> np.ndarray:
        v = s[3:]
        return np.concatenate([v, -drag_per_m * np.linalg.norm(v) * v + np.cross(spin_per_s, v) - [0, 0, GRAVITY_MPS2]])

    there = solve_ivp(rates, (0.0, float(t_s[-1]) + 1e-9), start, "DOP853", t_eval=t_s, rtol=1e-11, atol=1e-12)
    return there.y[:3].T


START = np.array([0.6, 0.2, 0.3, -5.5, -0.3, 1.6])
DRAG_PER_M, SPIN_PER_S = 0.17, np.array([0.3, -1.1, 0.8])


def test_a_flight_of_known_air_is_the_solution_of_its_equation_of_motion() -> None:
    t_us = np.concatenate([np.arange(0, 12_000, 500), np.arange(12_000, 400_000, 7_300)])
    flight = FittedFlight(0, 400_000, np.concatenate([START, [DRAG_PER_M], SPIN_PER_S]), 0.0)
    np.testing.assert_allclose(flight.at(t_us), flown(t_us * 1e-6, START, DRAG_PER_M, SPIN_PER_S), atol=1e-8)


def test_drag_and_spin_are_read_off_labels_of_both_cameras() -> None:
    t = np.arange(0, 380_000, 5_000)
    path = flown(t * 1e-6, START, DRAG_PER_M, SPIN_PER_S)
    flight = fit_flight((LEFT, RIGHT), (labels_of(LEFT, t, path), labels_of(RIGHT, t, path)))
    assert flight is not None and flight.residual_px < 0.2
    # What is believed of them beforehand draws a little: drag 0.112 +- 0.06, spin 0 +- 1.
    assert flight.values[6] == pytest.approx(DRAG_PER_M, abs=0.006)
    np.testing.assert_allclose(flight.values[7:], SPIN_PER_S, atol=0.1)
    np.testing.assert_allclose(flight.values[:6], START, atol=0.03)
    np.testing.assert_allclose(flight.at(t), path, atol=0.0015)


def test_where_labels_say_nothing_of_them_drag_and_spin_are_what_balls_have() -> None:
    # Over 30 ms the air moves the ball by half a millimetre, and labels err by a pixel, which is two.
    t = np.arange(0, 40_000, 10_000)
    path = flown(t * 1e-6, START, 0.112, np.zeros(3))
    for seed in range(3):
        off = np.random.default_rng(seed).normal(0, 1.0, (2, 4, 2))
        flight = fit_flight((LEFT, RIGHT), (labels_of(LEFT, t, path, off[0]), labels_of(RIGHT, t, path, off[1])))
        assert flight is not None
        assert flight.values[6] == pytest.approx(0.112, abs=0.03)
        np.testing.assert_allclose(flight.values[7:], 0.0, atol=0.7)


def test_a_flight_is_seen_between_its_first_and_last_label_and_nowhere_else() -> None:
    flight = FittedFlight(1000, 200_000, np.concatenate([START, [DRAG_PER_M], SPIN_PER_S]), 0.8)
    curve = curve_of_flight(flight, LEFT, [999, 1000, 100_000, 200_000, 200_001])
    assert np.isfinite(curve.x_px).tolist() == [False, True, True, True, False]
    assert curve.segment.tolist() == [NOT_COVERED, 0, 0, 0, NOT_COVERED]
    np.testing.assert_allclose(curve.sigma_px[1:4], 0.8)
    circles = ball_circles(LEFT, flight.at([1000, 100_000, 200_000]))
    np.testing.assert_allclose(curve.x_px[1:4], circles.u_px)
    np.testing.assert_allclose(curve.r_px[1:4], circles.r_px)
    assert curve_of_flight(flight, LEFT, [1000], keyframe_sigma_px=1.5).sigma_px[0] == 1.5


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_pairs_are_no_flight(count: int) -> None:
    t = np.arange(count) * 10_000
    assert fit_flight((LEFT, RIGHT), (labels_of(LEFT, t, POINTS[:count]), labels_of(RIGHT, t, POINTS[:count]))) is None


def test_positions_that_no_ball_flies_through_are_no_flight() -> None:
    t = np.arange(10) * 20_000
    assert fit_flight((LEFT, RIGHT), (labels_of(LEFT, t, POINTS[:10]), labels_of(RIGHT, t, POINTS[:10]))) is None


def test_a_missing_position_does_not_disturb_the_others() -> None:
    uvs = LEFT.project(POINTS)
    with_gap = np.vstack([uvs, [(np.nan, np.nan)]])
    np.testing.assert_array_equal(LEFT.undistort(with_gap)[:-1], LEFT.undistort(uvs))


@pytest.mark.parametrize(
    ("r_px", "expected_r_px", "off"),
    [
        (12.23, 8.5, True),
        (5.0, 8.5, True),
        (9.0, 8.5, False),
        (3.0, 2.2, False),  # a small ball: no hand is so exact
        (float("nan"), 8.5, False),
        (8.5, float("nan"), False),
    ],
)
def test_a_radius_is_off_where_it_is_clearly_not_the_balls(r_px: float, expected_r_px: float, off: bool) -> None:
    assert radius_is_off(r_px, expected_r_px) == off
