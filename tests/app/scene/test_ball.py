"""The ball's pictures, as they are sent to a browser."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
import viser

from app.scene.ball import BallActors
from app.scene.painted import GLOW_TO
from app.scene.view_camera import LIFT_M, MIN_SHARE, ViewCamera
from core.table import BALL_RADIUS_M

SPRITES = ("/world/ball-sprite", "/world/truth-sprite")


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def radius_m(server: viser.ViserServer, name: str, *, scaled: bool = True) -> float:
    """Of the ball that is painted on a sprite, as it stands in the scene."""
    image = server.scene._handle_from_node_name[name]
    assert isinstance(image, viser.ImageHandle)
    scale = float(np.max(image.scale)) if scaled else 1.0
    return image.render_width / (2 * GLOW_TO) * scale


@pytest.mark.parametrize("name", SPRITES)
def test_a_ball_that_has_no_scale_yet_is_no_larger_than_a_ball(server: viser.ViserServer, name: str) -> None:
    """A browser may show a picture for a frame before its scale: one made 2 m large filled the whole view then."""
    BallActors(server.scene, "/world")
    assert radius_m(server, name) == pytest.approx(BALL_RADIUS_M)
    assert radius_m(server, name, scaled=False) == pytest.approx(BALL_RADIUS_M)


def test_from_near_the_ball_is_as_large_as_it_is_and_from_far_a_share_of_the_picture(server: viser.ViserServer) -> None:
    ball = BallActors(server.scene, "/world")
    fov_rad, wxyz = math.radians(40), np.array([1.0, 0.0, 0.0, 0.0])  # looks along +z
    for away_m in (1.0, 6.0, 20.0):
        at = np.array([0.0, 0.0, 1.0])
        ball.show(at, None, ViewCamera(at - (0.0, 0.0, away_m), wxyz, fov_rad))
        least_m = MIN_SHARE * 2 * away_m * math.tan(fov_rad / 2)
        image = server.scene._handle_from_node_name["/world/ball-sprite"]
        nearer = float(np.linalg.norm(image.position - at)) / away_m
        wanted_m = max(BALL_RADIUS_M, least_m) * (1 - nearer)
        assert nearer * away_m >= LIFT_M * 0.999 and image.visible
        assert radius_m(server, "/world/ball-sprite") == pytest.approx(wanted_m, rel=0.03)
