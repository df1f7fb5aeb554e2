"""First estimates from a place, against what numpy makes of the same events."""

import numpy as np
import pytest

from core.detection.refined.ball_fit import start_from_place
from core.detection.refined.history import Recent

pytestmark = pytest.mark.numeric
END_US = 90_000
BOX = np.array([60.0, 50.0, 40.0, 40.0])


def events_of_a_ring(count: int, *, over_us: int = 4000) -> Recent:
    """Events on the rim of a disc of 8 px that is at (64, 48) at the end and moves by (1.5, -0.5) px/ms."""
    rng = np.random.default_rng(8)
    t = np.sort(rng.integers(END_US - over_us, END_US, count))
    angle, ms = rng.uniform(0, 2 * np.pi, count), (t - END_US) * 1e-3
    x = np.round(64 + 1.5 * ms + 8 * np.cos(angle)).astype(np.uint16)
    y = np.round(48 - 0.5 * ms + 8 * np.sin(angle)).astype(np.uint16)
    return Recent(t, x, y, rng.random(count) < 0.5)


def test_place_velocity_and_radius_are_those_of_the_regression() -> None:
    seen, estimate = events_of_a_ring(600), np.zeros(5)
    assert start_from_place(seen, BOX, END_US, 3000, estimate)
    late = seen.t_us >= END_US - 3000
    ms = (seen.t_us[late] - END_US) * 1e-3
    lines = [np.polyfit(ms, column[late].astype(float), 1) for column in (seen.x_px, seen.y_px)]
    off = [column[late] - np.polyval(line, ms) for column, line in zip((seen.x_px, seen.y_px), lines, strict=True)]
    radius = np.sqrt(np.mean(off[0] ** 2 + off[1] ** 2))
    assert estimate == pytest.approx([lines[0][1], lines[1][1], lines[0][0], lines[1][0], radius], abs=1e-9)
    assert estimate == pytest.approx([64, 48, 1.5, -0.5, 8], abs=1.0), "and near the truth"


def test_events_outside_the_box_or_before_the_span_do_not_count() -> None:
    seen, far, near = events_of_a_ring(600), np.zeros(5), np.zeros(5)
    elsewhere = Recent(*(np.concatenate([one, one]) for one in seen))
    elsewhere.x_px[600:] = 100
    order = np.argsort(elsewhere.t_us, kind="stable")
    assert start_from_place(Recent(*(one[order] for one in elsewhere)), BOX, END_US, 3000, far)
    assert start_from_place(seen, BOX, END_US, 3000, near)
    assert far == pytest.approx(near)


@pytest.mark.parametrize(("count", "over_us"), [(11, 4000), (600, 1)], ids=["too few", "all at once"])
def test_too_little_is_no_estimate(count: int, over_us: int) -> None:
    assert not start_from_place(events_of_a_ring(count, over_us=over_us), BOX, END_US, 4000, np.zeros(5))
