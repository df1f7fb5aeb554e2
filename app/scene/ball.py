"""The ball and the truth beside it, the ball's shadow, and the rays that found it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.painted import BALL_CORE_RGB, BALL_RIM_RGB, BALL_RING_RGB, GLOW_TO, ball_picture, ring_picture
from app.scene.shadow import Shadow, ShadowActor, shadow_of
from app.scene.view_camera import FLOOR_MIDDLE, LIFT_M, ViewCamera, drawn_radius_m, lift_before_floor_m, sprite_pose
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]
BALL_RGB: Final = BALL_RING_RGB
CORE_RGB: Final = BALL_CORE_RGB
RIM_RGB: Final = BALL_RIM_RGB
TRUTH_RGB: Final = (255, 255, 255)
RAY_RGB: Final = (150, 156, 168)
RAY_PX: Final = 1.2
HULL: Final = 1.6
"""Without an eye that is known, the ball is in an orange hull of so many of its radii, of which the back is seen."""


class BallActors:
    """Everything that stands where the ball is, in one browser's scene.

    A ball of 40 mm is some pixels in a view of the whole table. So where the browser's eye is known, it is a picture
    that faces the eye and is never smaller than a share of the view; else a sphere with an outline.
    """

    def __init__(self, scene: viser.SceneApi, root: str, cameras: int) -> None:
        self._ball = scene.add_icosphere(f"{root}/ball", BALL_RADIUS_M, CORE_RGB, visible=False, cast_shadow=False)
        self._hull = scene.add_icosphere(
            f"{root}/hull", HULL * BALL_RADIUS_M, BALL_RGB, side="back", visible=False, cast_shadow=False
        )
        self._sprite = _Sprite(scene, f"{root}/ball-sprite", ball_picture())
        self._truth_sprite = _Sprite(scene, f"{root}/truth-sprite", ring_picture(TRUTH_RGB))
        self._truth = scene.add_icosphere(
            f"{root}/truth", 1.12 * BALL_RADIUS_M, TRUTH_RGB, wireframe=True, visible=False, subdivisions=2
        )
        self._shadow = ShadowActor(scene, f"{root}/shadow")
        rays = np.zeros((max(1, cameras), 2, 3), np.float32)
        self._rays = scene.add_line_segments(
            f"{root}/rays", rays, RAY_RGB, thickness=RAY_PX, thickness_units="screen", visible=False
        )

    def show(self, ball: Array | None, truth: Array | None, eye: ViewCamera | None) -> None:
        """The ball (3,) as it was measured and the true one, seen from an eye; None hides them.

        The measured ball covers the true one where the two agree.
        """
        for handle, p in ((self._ball, ball), (self._hull, ball), (self._truth, truth)):
            _stand(handle, p if eye is None else None)
        radius_m = BALL_RADIUS_M if eye is None or ball is None else drawn_radius_m(eye, ball, BALL_RADIUS_M)
        shadow = None if ball is None else shadow_of(ball, radius_m)
        self._shadow.show(None if shadow is None or _behind_floor(shadow, eye) else shadow)
        if ball is None or eye is None:
            self._sprite.hide()
        else:
            self._sprite.show(ball, eye, radius_m, lift_before_floor_m(eye, ball, LIFT_M))
        covered = ball is not None and truth is not None and float(np.abs(truth - ball).max()) < 0.3 * radius_m
        if truth is None or eye is None or covered:
            self._truth_sprite.hide()
        else:
            lift_m = lift_before_floor_m(eye, truth, 0.9 * LIFT_M)
            self._truth_sprite.show(truth, eye, drawn_radius_m(eye, truth, BALL_RADIUS_M), lift_m)

    def show_rays(self, rays_world_m: Sequence[tuple[Array, Array]]) -> None:
        """From each camera that sees the ball to where it is seen; none hide them."""
        self._rays.visible = bool(rays_world_m)
        if rays_world_m:
            filled = [*rays_world_m, *[rays_world_m[0]] * (len(self._rays.points) - len(rays_world_m))]
            self._rays.points = np.array(filled, np.float32)


class _Sprite:
    """A picture that faces the eye. What did not change is not sent: each value costs the server 70 us.

    Unscaled it is as large as the ball itself: a browser may draw it for a frame before it has its scale.
    """

    def __init__(self, scene: viser.SceneApi, name: str, picture: NDArray[np.uint8]) -> None:
        size = 2 * GLOW_TO * BALL_RADIUS_M
        self._image = scene.add_image(
            name, picture, size, size, format="png", visible=False, cast_shadow=False, receive_shadow=False
        )
        self._wxyz: Array | None = None
        self._scale = 1.0

    def hide(self) -> None:
        self._image.visible = False

    def show(self, p_world_m: Array, eye: ViewCamera, radius_m: float, lift_m: float) -> None:
        """Stand before a point (3,), as large as `radius_m` is there."""
        pose = sprite_pose(eye, p_world_m, radius_m, lift_m)
        self._image.position = pose.p_world_m
        if self._wxyz is None or (pose.wxyz != self._wxyz).any():
            self._image.wxyz = self._wxyz = pose.wxyz
        scale = pose.scale / BALL_RADIUS_M
        if not 0.97 < scale / self._scale < 1.03:
            self._image.scale = self._scale = scale
        self._image.visible = True


def _behind_floor(shadow: Shadow, eye: ViewCamera | None) -> bool:
    """Lies on the floor beyond its middle, where it would be drawn with dark corners: see `lift_before_floor_m`."""
    p = np.array([shadow.x_m, shadow.y_m, shadow.z_m])
    return eye is not None and shadow.z_m < 0 and eye.depth_m(p) > eye.depth_m(FLOOR_MIDDLE)


def _stand(ball: viser.IcosphereHandle, p_world_m: Array | None) -> None:
    ball.visible = p_world_m is not None
    if p_world_m is not None:
        ball.position = p_world_m
