"""The empty room in a camera, against the geometry of table, lines and net said with points instead of rays."""

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from core.cameras import Camera
from core.events import SensorSize
from core.simulation import SceneConfig
from core.simulation.scenes.background import (
    DEPTH_M,
    LIGHT,
    LOG_LIGHT,
    NET_COVER,
    NET_LIGHT,
    RAY_X,
    RAY_Y,
    make_background,
)
from core.table import CENTRE_LINE_WIDTH_M, LINE_WIDTH_M, TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric
SCENE = SceneConfig()
FINE = 30
"""Rays along each side of a pixel in the picture that is compared with."""


@pytest.fixture(scope="module")
def above(small_camera: Camera) -> Camera:
    """Looks down on a corner of the table and its lines from 1.5 m, turned a little: a line is 8 px wide."""
    T = small_camera.T_world_camera.copy()
    turn = np.deg2rad(20.0)
    T[:3, :3] = np.array([[np.cos(turn), np.sin(turn), 0], [np.sin(turn), -np.cos(turn), 0], [0, 0, -1.0]])
    T[:3, 3] = (-1.35, -0.74, 1.5)
    return dataclasses.replace(small_camera, T_world_camera=T)


def table_light(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of points (..., 2) in the table's plane."""
    to_end, to_side = TABLE_LENGTH_M / 2 - np.abs(p[..., 0]), TABLE_WIDTH_M / 2 - np.abs(p[..., 1])
    inward = np.minimum(to_end, to_side)
    lines = (inward < LINE_WIDTH_M) | (np.abs(p[..., 1]) < CENTRE_LINE_WIDTH_M / 2)
    return np.where(inward < 0, SCENE.floor, np.where(lines, SCENE.line, SCENE.table))


def on_table(camera: Camera, uvs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the rays of pixels (..., 2) meet the table's plane."""
    rays = np.concatenate([(uvs - camera.K[:2, 2]) / np.diag(camera.K)[:2], np.ones((*uvs.shape[:-1], 1))], -1)
    rays = rays @ camera.T_world_camera[:3, :3].T
    start = camera.T_world_camera[:3, 3]
    return (start - rays * (start[2] / rays[..., 2:]))[..., :2]


def test_light_and_depth_of_table_and_lines(above: Camera) -> None:
    maps, size = make_background(above, SCENE).astype(np.float64), above.sensor
    uvs = np.stack(np.meshgrid(np.arange(size.width_px), np.arange(size.height_px)), -1).reshape(-1, 2).astype(float)
    np.testing.assert_allclose(maps[:, [RAY_X, RAY_Y]], (uvs - above.K[:2, 2]) / np.diag(above.K)[:2], atol=1e-6)
    inside = (np.arange(FINE) + 0.5) / FINE - 0.5
    within = np.stack(np.meshgrid(inside, inside), -1).reshape(1, -1, 2)
    samples = table_light(on_table(above, uvs[:, None] + within))
    fine, edges = samples.mean(axis=1), np.ptp(samples, axis=1) > 0
    off = maps[:, LIGHT] - fine
    assert edges.sum() > 150
    np.testing.assert_allclose(off[~edges], 0.0, atol=1e-6)
    assert np.abs(off).max() < 0.3 * SCENE.line, "three rays along each side of a pixel"
    for downwards in (1, -1):  # rays a fraction of a pixel beside their place make one side of a line too bright
        gradient = np.gradient(fine.reshape(size.height_px, -1), axis=0).ravel() * downwards > 0.05
        assert abs(off[edges & gradient].mean()) < 0.005
    table = (np.abs(on_table(above, uvs)) < [TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2]).all(axis=1)
    np.testing.assert_allclose(maps[table, DEPTH_M], 1.5, rtol=1e-6)
    assert not maps[:, [NET_LIGHT, NET_COVER]].any() and table.sum() > 1000
    np.testing.assert_allclose(maps[:, LOG_LIGHT], np.log(maps[:, LIGHT]), atol=1e-6)


def test_depth_is_that_of_the_ray_through_the_middle_of_a_pixel() -> None:
    """Along a table seen at a flat angle depth changes by centimetres from one row to the next."""
    K = np.array([[60.0, 0, 15.5], [0, 60.0, 11.5], [0, 0, 1]])
    tilt = np.deg2rad(15.0)
    T = np.eye(4)
    T[:3, :3] = np.array([[0, -np.sin(tilt), np.cos(tilt)], [-1.0, 0, 0], [0, -np.cos(tilt), -np.sin(tilt)]])
    T[:3, 3] = (-1.3, 0.0, 0.3)
    camera = Camera(SensorSize(32, 24), K, np.zeros(5), T)
    maps = make_background(camera, SCENE).astype(np.float64)
    ray = np.column_stack([maps[:, RAY_X], maps[:, RAY_Y], np.ones(len(maps))]) @ T[:3, :3].T
    with np.errstate(divide="ignore"):
        z = np.where(ray[:, 2] < 0, -T[2, 3] / ray[:, 2], np.inf)
    meets = np.abs(T[:3, 3] + z[:, None] * ray)[:, :2] < [TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2]
    on = meets.all(axis=1)
    assert on.sum() > 100 and np.ptp(z[on]) > 0.5
    np.testing.assert_allclose(maps[on, DEPTH_M], z[on], rtol=1e-5)
