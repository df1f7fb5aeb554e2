"""What the ball touches first: nets, let cords, edges, ends and floors, each a ball thrown at it."""

from __future__ import annotations

import numpy as np
import pytest

from core.physics import contact
from core.physics.config import physics_profile
from core.physics.contact import next_contact
from core.physics.flight import air_from_config
from core.table import GRAVITY_MPS2

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
