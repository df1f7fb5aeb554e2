from __future__ import annotations

import numpy as np
import pytest

from core.cameras import ball_circles, stereo_preset
from labels.arrays import LabelArrays, label_arrays
from labels.assist import (
    check_labels,
    curve_of_flight,
    fit_flight,
    interpolate,
    labels_from_curve,
)
from labels.model import Label, LabelState, PositionSource

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset("side")
T = np.arange(0, 200_000, 20_000)


def path(t_us: np.ndarray) -> np.ndarray:
    s = t_us[:, None] * 1e-6
    return np.array([0.3, 0.1, 0.3]) + np.array([-4.5, -0.3, 1.0]) * s - np.array([0, 0, 4.905]) * s**2


def labels_of(name: str, t_us: np.ndarray) -> LabelArrays:
    circles = ball_circles(CAMERAS[name], path(t_us))
    return label_arrays(
        Label(t_us=int(t), state=LabelState.VISIBLE, x_px=float(u), y_px=float(v), r_px=float(r))
        for t, u, v, r in zip(t_us, circles.u_px, circles.v_px, circles.r_px, strict=True)
    )


def test_an_interpolation_becomes_labels_only_where_it_is_covered() -> None:
    curve = interpolate(labels_of("left", T), [10_000, 30_000, 500_000])
    labels = labels_from_curve(curve)
    assert [label.t_us for label in labels] == [10_000, 30_000]
    assert all(label.provenance.source is PositionSource.INTERPOLATED for label in labels)
    assert labels[0].covariance_px2 is not None and labels[0].covariance_px2[0] > 0


def test_a_flight_seen_by_a_camera_is_such_an_interpolation_too() -> None:
    flight = fit_flight((CAMERAS["left"], CAMERAS["right"]), (labels_of("left", T), labels_of("right", T)))
    assert flight is not None
    curve = curve_of_flight(flight, CAMERAS["left"], [-5, 50_000, 130_000, 190_000])
    np.testing.assert_array_equal(curve.covered, (False, True, True, False))
    truth = labels_of("left", np.array([50_000, 130_000]))
    np.testing.assert_allclose(curve.x_px[1:3], truth.x_px, atol=0.2)
    assert len(labels_from_curve(curve, made_of="flight")) == 2


def test_cameras_that_were_labelled_at_different_instants_are_compared_through_the_curve() -> None:
    here, there = labels_of("left", T + 7000), labels_of("right", T)
    check = check_labels(CAMERAS["left"], here, CAMERAS["right"], there)
    assert np.isnan(check.residual_px[-1])  # beyond the other camera's last label
    assert np.nanmax(check.residual_px) < 0.3
    np.testing.assert_allclose(check.p_world_m[:-1], path(T + 7000)[:-1], atol=0.002)
    same = check_labels(CAMERAS["left"], labels_of("left", T[:2]), CAMERAS["right"], labels_of("right", T[:2]))
    assert np.nanmax(same.residual_px) < 0.3  # two labels are too few for a curve, but they are of the same instants


def test_a_label_without_a_ball_has_nothing_to_agree_with() -> None:
    absent = label_arrays([Label(t_us=0, state=LabelState.NO_BALL)])
    assert np.isnan(check_labels(CAMERAS["left"], absent, CAMERAS["right"], labels_of("right", T)).residual_px).all()
