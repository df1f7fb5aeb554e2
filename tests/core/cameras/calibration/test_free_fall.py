import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core.cameras.calibration.free_fall import find_arcs, measure_gravity
from core.errors import CalibrationError

pytestmark = pytest.mark.numeric
INFORMATION = np.eye(3) / 0.002**2


def flights(count: int, noise: float, *, drag_per_m: float = 0.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Times and places of balls thrown in different directions, with a bounce in each flight."""
    rng = np.random.default_rng(seed)
    times, places, start_us = [], [], 0.0
    for _ in range(count):
        p, v = rng.uniform((-1, -1, 0.3), (1, 1, 0.6)), rng.uniform((-5, -2, 0.5), (5, 2, 2.0))
        for step in range(300):
            if step % 2 == 0:
                times.append(start_us + 1000.0 * step)
                places.append(p.copy())
            a = np.array([0, 0, -9.81]) - drag_per_m * np.linalg.norm(v) * v
            p, v = p + v * 1e-3 + a * 0.5e-6, v + a * 1e-3
            if p[2] < 0 and v[2] < 0:
                v[2] *= -0.9
        start_us += 500_000.0
    return np.array(times), np.array(places) + rng.normal(0, noise, (len(places), 3))


def test_flights_are_cut_at_pauses_and_bounces() -> None:
    t_us, ps = flights(6, 0.001)
    arcs = find_arcs(t_us, ps, np.broadcast_to(INFORMATION, (len(ps), 3, 3)))
    assert 6 <= len(arcs) <= 12
    for rows in arcs:
        t = 1e-6 * (t_us[rows] - t_us[rows[0]])
        off = ps[rows] - np.polynomial.Polynomial.fit(t, ps[rows][:, 2], 2)(t)[:, None]
        assert np.std(off[:, 2]) < 0.002, "a parabola and no bounce"


@pytest.mark.parametrize("drag_per_m", [0.0, 0.155])
def test_scale_and_vertical_come_out_in_any_frame_and_unit(drag_per_m: float) -> None:
    t_us, ps = flights(10, 0.002, drag_per_m=drag_per_m)
    R = Rotation.from_euler("xyz", (40, -70, 25), degrees=True).as_matrix()
    units = 3.5
    turned = ps @ R.T / units
    information = np.broadcast_to(R @ INFORMATION @ R.T * units**2, (len(ps), 3, 3))
    found = measure_gravity(t_us, turned, information, drag_per_m=drag_per_m)
    assert found.metres_per_unit == pytest.approx(units, rel=0.005)
    assert abs(found.metres_per_unit / units - 1) < 5 * found.sigma_relative
    assert np.degrees(np.arccos(found.up @ R[:, 2])) < 0.3


def test_standard_deviations_of_scale_and_vertical_are_honest() -> None:
    scales, tilts = [], []
    for seed in range(30):
        t_us, ps = flights(6, 0.002, seed=seed)
        found = measure_gravity(t_us, ps, np.broadcast_to(INFORMATION, (len(ps), 3, 3)), drag_per_m=0.0)
        scales.append((found.metres_per_unit - 1) / found.sigma_relative)
        tilts.append(found.up[:2] / found.sigma_up_rad)  # along each of two axes
    # Of a normal distribution half is within 0.674; now and then a bounce is not noticed, which is in no sigma.
    assert 0.4 < np.median(np.abs(scales)) < 1.05
    assert 0.52 < np.median(np.abs(tilts)) < 0.86


def test_air_that_is_forgotten_is_seen_in_the_scale() -> None:
    t_us, ps = flights(10, 0.001, drag_per_m=0.155)
    information = np.broadcast_to(INFORMATION, (len(ps), 3, 3))
    right, wrong = (measure_gravity(t_us, ps, information, drag_per_m=drag) for drag in (0.155, 0.0))
    assert abs(right.metres_per_unit - 1) < 0.005 < abs(wrong.metres_per_unit - 1)


def test_a_ball_in_a_hand_knows_no_gravity() -> None:
    t_us = np.arange(0, 4_000_000, 2000.0)
    t = 1e-6 * t_us
    ps = 0.4 * np.column_stack([np.sin(5 * t), np.sin(7 * t + 1), np.sin(6 * t + 2)])
    with pytest.raises(CalibrationError, match=r"do not agree on gravity|too little free flight"):
        measure_gravity(t_us, ps, np.broadcast_to(INFORMATION, (len(ps), 3, 3)), drag_per_m=0.0)
    with pytest.raises(CalibrationError, match="expected 3 arcs of 80 ms, got 0"):
        measure_gravity(t_us[:10], ps[:10], np.broadcast_to(INFORMATION, (10, 3, 3)), drag_per_m=0.0)
