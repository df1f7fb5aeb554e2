"""All of the stage is in the picture, whatever its shape, and no view wastes it."""

import math

import numpy as np
import pytest

from app.scene.view_camera import FRAMED, MARGIN, STAGE, VIEWPOINTS, framed, stage_with, standpoint
from app.views.viewpoint import Viewpoint
from core.cameras import stereo_preset
from core.cameras.presets import camera_preset
from core.geometry import look_at
from core.history.rally_picture import People
from core.simulation.bodies import make_actors

ASPECTS = [0.4, 0.8, 1.0, 1.16, 1.78]


def reach(view: Viewpoint, points: np.ndarray, aspect: float) -> np.ndarray:
    """(N, 2) where points are: from -1 to 1 inside of the picture."""
    T = look_at(view.position, view.look_at)
    seen = (points - T[:3, 3]) @ T[:3, :3]
    half = math.tan(view.fov_rad / 2)
    assert (seen[:, 2] > 0).all()
    return seen[:, :2] / seen[:, 2:] / [half * aspect, half]


@pytest.mark.parametrize("aspect", ASPECTS)
@pytest.mark.parametrize("name", sorted(FRAMED))
def test_every_framed_view_shows_the_whole_stage_and_fills_the_picture(name, aspect) -> None:
    found = reach(standpoint(name, aspect), STAGE, aspect)
    free = 1 - 2 * MARGIN
    assert np.abs(found).max() == pytest.approx(free, abs=1e-6)
    tight = int(np.argmax(np.abs(found).max(axis=0)))
    assert found[:, tight].min() == pytest.approx(-free, abs=1e-6), "as far as it goes on both sides"
    assert found[:, tight].max() == pytest.approx(free, abs=1e-6)


def test_a_framed_view_keeps_its_direction() -> None:
    view = VIEWPOINTS["Side"]
    moved = framed(view, STAGE, 1.0)
    before, after = (np.subtract(one.look_at, one.position) for one in (view, moved))
    np.testing.assert_allclose(before / np.linalg.norm(before), after / np.linalg.norm(after), atol=1e-9)


def test_persons_are_seen_whole() -> None:
    bodies = make_actors("rally", 3)
    assert bodies is not None
    ends = bodies.ends(np.array([0.2]))[0]
    stage = stage_with(People(bodies.parts, ends))
    found = reach(standpoint("Broadcast", 1.0, stage=stage), ends.reshape(-1, 3), 1.0)
    assert np.abs(found).max() < 1 and stage_with(None) is STAGE


@pytest.mark.parametrize("aspect", ASPECTS)
def test_all_of_many_cameras_are_in_every_framed_view_and_a_pair_changes_none(aspect) -> None:
    rig = camera_preset("corners")
    stage = stage_with(None, rig.values())
    places = np.array([camera.position_world_m for camera in rig.values()])
    for name in FRAMED:
        assert np.abs(reach(standpoint(name, aspect, stage=stage), places, aspect)).max() < 1
    assert stage_with(None, stereo_preset().values()) is STAGE
