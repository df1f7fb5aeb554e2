"""A part in 64 pixels at once against one pixel at a time, as plain as it can be said."""

import math

import numpy as np
import pytest

from core.simulation.bodies.parts import blade, rod
from core.simulation.bodies.shading import SHEET, draw_sheet, posed_bodies, posed_parts
from core.simulation.bodies.view import make_scene_view
from core.simulation.scenes.background import make_background
from core.simulation.scenes.racket_view import racket_gap
from core.simulation.scenes.scene import SceneConfig

pytestmark = pytest.mark.numeric
PARTS = np.array(
    [rod(0.04, 0.07, 0.4), rod(0.05, 0.05, 0.3, texture=0.5, stripes_per_m=11.0, bands=2.0), blade(0.08, 0.05)]
)
ENDS = np.array(
    [
        [[0.0, 0.0, 1.5], [0.05, 0.1, 1.6]],
        [[0.02, -0.03, 1.4], [0.02, -0.03, 1.4]],
        [[0.0, 0.0, 1.5], [0.004, 0.002, 1.51]],
    ]
)


def step(share: float) -> float:
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


def wave(phase: float) -> float:
    u = 2.0 * (phase % 1.0)
    return 4.0 * u * (1.0 - u) if u < 1.0 else 4.0 * (u - 1.0) * (u - 2.0)


def rod_in_pixel(index: int, x: float, y: float, edge: float, ambient: float, view) -> tuple[float, float, float]:
    a, b = ENDS[index]
    _, radius_a, radius_b, reflectance, texture, stripes, bands = PARTS[index]
    ray = np.array([x, y, 1.0])
    length2, d = ray @ ray, b - a
    across = d @ d - (d @ ray) ** 2 / length2
    share = 0.0
    if across > 1e-12:
        share = min(max(((a @ ray) * (d @ ray) / length2 - a @ d) / across, 0.0), 1.0)
    c, radius = a + share * d, radius_a + share * (radius_b - radius_a)
    along, width = (c @ ray) / length2, edge * (a + share * d)[2]
    gap = math.sqrt(max(c @ c - along**2 * length2, 0.0))
    z = along - math.sqrt(max(radius**2 - gap**2, 0.0) / length2)
    normal = (z * ray - c) / radius
    light = reflectance * (ambient + (1.0 - ambient) * 0.5 * (1.0 + normal @ view[12:15]))
    if texture > 0:
        length = np.linalg.norm(d)
        up = normal @ view[3:6]
        light *= 1.0 + 0.5 * texture * (wave(share * length * stripes + 0.13) + wave(up * bands + 0.37))
    return step((radius - gap) / width + 0.5), light, z


@pytest.mark.parametrize("index", [0, 1, 2])
def test_a_part_in_many_pixels_is_what_it_is_in_each(small_camera, index) -> None:
    scene = SceneConfig()
    view = make_scene_view(small_camera, scene, make_background(small_camera, scene), PARTS)
    posed = posed_bodies(ENDS, np.zeros((3, 2, 3)))
    posed_parts(view, posed)
    rng = np.random.default_rng(index)
    x, y = rng.uniform(-0.1, 0.1, (2, SHEET)).astype(np.float32).astype(np.float64)
    sheet = np.concatenate([x, y, x * x + y * y + 1.0, np.full(3 * SHEET, np.nan)])
    assert draw_sheet(posed.rows[index], sheet, view.edge_per_m, view.ambient, view.numbers)
    covers, lights, zs = sheet[3 * SHEET :].reshape(3, SHEET)
    numbers, seen = np.array(view.numbers), 0
    for at in range(SHEET):
        if index == 2:
            row = posed.rows[2]
            racket = (*row[:6], 0.0, *row[6:9], *row[12:16])
            gap, z = racket_gap(racket, x[at], y[at])
            cover, light = step(0.5 - gap / row[6]), 0.05
        else:
            cover, light, z = rod_in_pixel(index, x[at], y[at], view.edge_per_m, view.ambient, numbers)
        assert covers[at] == pytest.approx(cover, abs=1e-5)
        if cover > 0.0:
            seen += 1
            assert lights[at] == pytest.approx(light, rel=1e-6) and zs[at] == pytest.approx(z, rel=1e-5)
    assert 5 < seen < SHEET


def test_a_part_that_is_elsewhere_is_not_seen(small_camera) -> None:
    scene = SceneConfig()
    view = make_scene_view(small_camera, scene, make_background(small_camera, scene), PARTS)
    posed = posed_bodies(ENDS + np.array([0.9, 0.0, 0.0]), np.zeros((3, 2, 3)))
    posed_parts(view, posed)
    x = np.linspace(-0.1, 0.1, SHEET)
    sheet = np.concatenate([x, x, 2 * x * x + 1.0, np.zeros(3 * SHEET)])
    for index in range(3):
        assert not draw_sheet(posed.rows[index], sheet, view.edge_per_m, view.ambient, view.numbers)
