"""The copies of ball and cylinder cover the rods that the cameras see."""

import numpy as np
import pytest

from app.scene.people import balls_of, cylinders_of, part_colours
from core.geometry import matrix_from_quaternion
from core.history.rally_picture import People
from core.simulation.bodies import make_actors
from core.simulation.bodies.parts import blade, rod


def people(cast: str) -> People:
    bodies = make_actors(cast, 5)  # type: ignore[arg-type]
    assert bodies is not None
    return People(bodies.parts, bodies.ends(np.array([0.7]))[0])


@pytest.mark.parametrize("cast", ["person", "two-persons", "rally", "head"])
def test_every_cylinder_reaches_from_end_to_end(cast) -> None:
    shown = people(cast)
    found = cylinders_of(shown)
    for number, (position, wxyz, scale) in enumerate(zip(found.positions, found.wxyzs, found.scales, strict=True)):
        half = matrix_from_quaternion(wxyz) @ [0, 0, 0.5 * scale[2]]
        np.testing.assert_allclose([position - half, position + half], shown.ends_m[number], atol=1e-9)


def test_a_rod_that_points_down_is_turned_too() -> None:
    shown = People(np.array([rod(0.1, 0.1, 0.5)]), np.array([[[0.0, 0, 1], [0, 0, 0]]]))
    np.testing.assert_allclose(matrix_from_quaternion(cylinders_of(shown).wxyzs[0]) @ [0, 0, 1], [0, 0, -1], atol=1e-9)


def test_balls_have_the_radii_of_the_ends_and_blades_have_none() -> None:
    shown = People(np.array([rod(0.1, 0.2, 0.5), blade(0.08, 0.05)]), np.zeros((2, 2, 3)))
    assert balls_of(shown).scales[:, 0].tolist() == [0.1, 0.2, 0.0, 0.0]


def test_brighter_clothes_are_lighter() -> None:
    dark, bright = part_colours(np.array([rod(0.1, 0.1, 0.05), rod(0.1, 0.1, 0.6)])).astype(int)
    assert (bright - dark > 50).all()
