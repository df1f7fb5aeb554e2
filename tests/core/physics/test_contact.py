"""What the ball touches first: nets, let cords, edges, ends and floors, each a ball thrown at it."""

from __future__ import annotations

import numpy as np
import pytest

from core.physics import contact
from core.physics.config import physics_profile
from core.physics.contact import come_down, cross_net_plane, highest_point, next_contact, over_table, overlaps_net
from core.physics.flight import air_from_config, fly
from core.table import GRAVITY_MPS2

pytestmark = pytest.mark.numeric
PROFILES = ("paper", "real")


def first_touch(p: tuple[float, float, float], v: tuple[float, float, float], profile: str = "paper") -> int:
    air = air_from_config(physics_profile("paper" if profile == "paper" else "real"))
    what, t = next_contact(np.array([*p, *v, 0.0, 0.0, 0.0]), air, np.empty(9))
    assert t >= 0
    return what


def over_net_with_clearance(clearance_m: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """A ball that is level over the net with its lowest point this far above the cord."""
    t = 0.2
    z = 0.1525 + 0.02 + clearance_m - 0.5 * GRAVITY_MPS2 * t * t
    return (-5.0 * t, 0.0, z), (5.0, 0.0, GRAVITY_MPS2 * t)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize(
    ("p", "v", "expected"),
    [
        ((-1.0, 0.0, 0.3), (1.0, 0.0, 0.0), contact.OWN_TOP),
        ((-1.0, 0.0, 0.3), (4.0, 0.0, 2.0), contact.FAR_TOP),
        ((-1.0, 0.0, 0.1), (5.0, 0.0, 1.0), contact.NET),
        ((-1.0, 0.0, 0.3), (9.0, 0.0, 3.0), contact.FLOOR),
        ((-1.0, 0.5, 0.3), (2.0, 4.0, 1.0), contact.FLOOR),
        ((-1.42, 0.0, -0.10), (3.0, 0.0, 0.3), contact.OWN_END),
        ((-1.42, 0.0, -0.10), (2.2, 0.0, 6.0), contact.FAR_TOP),
        ((-1.42, 0.9, -0.10), (3.0, 0.0, 0.3), contact.FLOOR),
        ((1.42, 0.0, -0.10), (-3.0, 0.0, 0.3), contact.FAR_END),
        ((-1.42, 0.0, 0.3), (-3.0, 0.0, 1.0), contact.FLOOR),
        ((1.0, 0.0, 0.1), (-5.0, 0.0, 1.0), contact.NET),
    ],
)
def test_a_thrown_ball_touches_what_is_in_its_way(
    p: tuple[float, float, float], v: tuple[float, float, float], expected: int, profile: str
) -> None:
    assert first_touch(p, v, profile) == expected


def test_a_let_cord_is_a_touch_of_the_net_and_a_millimetre_above_it_is_none() -> None:
    assert first_touch(*over_net_with_clearance(-0.001)) == contact.NET
    assert first_touch(*over_net_with_clearance(0.001)) == contact.FAR_TOP


@pytest.mark.parametrize(("y", "expected"), [(0.90, contact.NET), (0.93, contact.FLOOR)])
def test_the_net_stands_out_beyond_the_side_lines(y: float, expected: int) -> None:
    assert first_touch((-0.5, y, 0.1), (5.0, 0.0, 0.3)) == expected


@pytest.mark.parametrize(("miss_m", "expected"), [(-0.001, contact.FAR_TOP), (0.001, contact.FLOOR)])
@pytest.mark.parametrize("line", ["end", "side"])
def test_the_ball_s_lowest_point_decides_at_an_edge(line: str, miss_m: float, expected: int) -> None:
    t = 0.25
    landing = (1.37 + miss_m, 0.0) if line == "end" else (0.5, 0.7625 + miss_m)
    p = (landing[0] - 3.0 * t, landing[1], 0.02 + 0.5 * GRAVITY_MPS2 * t * t)
    assert first_touch(p, (3.0, 0.0, 0.0)) == expected


def test_a_ball_on_the_net_line_of_the_table_belongs_to_the_far_half() -> None:
    # Straight down on x = 0 is the net; a hair to either side is a half.
    assert first_touch((-1e-6, 0.0, 0.5), (0.0, 0.0, 0.0)) == contact.OWN_TOP
    assert first_touch((1e-6, 0.0, 0.5), (0.0, 0.0, 0.0)) == contact.FAR_TOP


def test_no_two_things_that_a_ball_may_touch_have_one_number() -> None:
    things = [contact.OWN_TOP, contact.NET, contact.FLOOR, contact.FAR_TOP, contact.OWN_END, contact.FAR_END]
    assert len({contact.NOTHING, *things}) == 7


def test_the_lines_belong_to_the_table_and_the_posts_to_the_net() -> None:
    for x, y in ((1.37, 0.7625), (-1.37, -0.7625)):
        assert over_table(x, y)
        assert not over_table(x * 1.001, y) and not over_table(x, y * 1.001)
    for side in (1, -1):  # 15.25 cm beyond the side line
        assert overlaps_net(0.9149 * side, 0.1) and not overlaps_net(0.9151 * side, 0.1)
    assert overlaps_net(0.0, 0.1724) and not overlaps_net(0.0, 0.1726), "a radius above the cord"
    assert overlaps_net(0.0, -0.0199) and not overlaps_net(0.0, -0.0201), "and a radius below the table"


@pytest.mark.parametrize("profile", PROFILES)
def test_times_of_the_table_the_net_and_the_top_are_those_of_small_steps(profile: str) -> None:
    air = air_from_config(physics_profile("paper" if profile == "paper" else "real"))
    for heading in (1.0, -1.0):
        start = np.array([-0.8 * heading, 0.1, 0.2, 4.0 * heading, 0.2, 2.5, 5.0, -60.0, 10.0])
        rows = [start]
        for _ in range(7000):
            rows.append(rows[-1].copy())
            fly(rows[-1], 1e-4, air, rows[-1])
        steps, out = np.array(rows), np.empty(9)
        for which, height in ((come_down, steps[:, 2] - 0.02), (cross_net_plane, -heading * steps[:, 0])):
            t = which(start, air, out)
            last = int(np.flatnonzero(height >= 0)[-1])
            assert last * 1e-4 <= t <= (last + 1) * 1e-4
            np.testing.assert_allclose(out, steps[round(t * 1e4)], atol=2e-3)
        top = highest_point(start, air, out)
        assert top == pytest.approx(np.argmax(steps[:, 2]) * 1e-4, abs=1e-4)
        assert out[2] == pytest.approx(steps[:, 2].max(), abs=1e-7) and out[5] == pytest.approx(0, abs=1e-7)
        np.testing.assert_allclose(out[:2], steps[round(top * 1e4), :2], atol=1e-3)


@pytest.mark.parametrize("profile", PROFILES)
def test_a_falling_ball_is_highest_now(profile: str) -> None:
    air = air_from_config(physics_profile("paper" if profile == "paper" else "real"))
    for climb in (0.0, -1.0):
        start, out = np.array([0.1, 0.2, 0.3, 1.0, 2.0, climb, 4.0, 5.0, 6.0]), np.empty(9)
        assert highest_point(start, air, out) == 0.0 and (out == start).all()


def test_each_touch_has_its_own_time_and_place() -> None:
    """Gravity alone: the end at x = -1.37, the floor a radius above -0.76, the net at x = 0."""
    air, out = air_from_config(physics_profile("paper")), np.empty(9)
    cases = [
        ((-1.42, 0.0, -0.10), (2.5, 0.0, 0.3), contact.OWN_END, 0.02),
        ((1.42, 0.1, -0.10), (-2.5, 0.0, 0.3), contact.FAR_END, 0.02),
        ((-0.5, 0.1, 0.1), (5.0, 0.0, 0.3), contact.NET, 0.1),
        ((2.0, 0.1, 0.2), (5.0, 0.0, 0.0), contact.FLOOR, (2 * (0.2 + 0.74) / GRAVITY_MPS2) ** 0.5),
    ]
    for p, v, expected, t in cases:
        what, when = next_contact(np.array([*p, *v, 0.0, 0.0, 0.0]), air, out)
        assert (what, when) == (expected, pytest.approx(t, abs=1e-9))
        assert out[:3] == pytest.approx(np.array(p) + np.array(v) * t - [0, 0, GRAVITY_MPS2 / 2 * t * t], abs=1e-9)
