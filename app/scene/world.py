"""The 3D scene of one browser, whole: shows a RallyPicture, with layers that can be switched off."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser

from app.scene.arena import add_arena
from app.scene.ball import BallActors
from app.scene.landing import LandingActors
from app.scene.prediction import PredictionActors
from app.scene.racket import RacketActor
from app.scene.rig import RigActors
from app.scene.uncertainty import UncertaintyActor
from app.scene.viewpoints import VIEWPOINTS, follow_viewpoint, viewpoint_of_camera
from app.views.viewpoint import Viewpoint, look
from core.cameras import Camera
from core.physics import TaskConfig
from core.rally.history.rally_picture import RallyPicture

ROOT: Final = "/world"
LAYERS: Final = (
    "Ball",
    "Trail",
    "True ball",
    "Rays",
    "Predictions",
    "Uncertainty",
    "Hitting plane",
    "Racket",
    "Racket target",
    "Landing target",
    "Landing spots",
    "Cameras",
)
FOLLOW_SHARE: Final = 0.15
_NO_PATH: Final = np.empty((0, 3))


class World:
    """Handles are made when it is first shown."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._scene = client.scene
        self._root: viser.FrameHandle | None = None
        self._cameras: dict[str, Camera] = {}
        self._rig: RigActors | None = None
        self._rig_number = 0
        self._view = "Broadcast"
        self.layers: frozenset[str] = frozenset(LAYERS)
        """Those that are drawn."""

    @property
    def visible(self) -> bool:
        """Whether it is what the middle of the window shows."""
        return self._root is not None and self._root.visible

    def show(self, visible: bool) -> None:
        """Show it or hide it; the camera is put where the view wants it."""
        if visible and self._root is None:
            self._build()
        if self._root is None or self._root.visible == visible:
            return
        self._root.visible = visible
        if visible:
            self.look_from(self._view)

    @property
    def view(self) -> str:
        """Name of the point of view that was chosen."""
        return self._view

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the points of view: fixed ones, and one a camera."""
        return (*VIEWPOINTS, *self._cameras)

    def look_from(self, view: str) -> None:
        """Take a point of view by its name; an unknown one changes nothing."""
        viewpoint = self._viewpoint(view)
        if viewpoint is not None:
            self._view = view
            if self.visible:
                look(self._client, viewpoint)

    def use_cameras(self, cameras: dict[str, Camera]) -> None:
        """Other cameras stand there."""
        if cameras == self._cameras:
            return
        self._cameras = cameras
        if self._root is not None:
            self._build_rig()

    def draw(self, picture: RallyPicture) -> None:
        """Show a moment; nothing is drawn before the scene was shown for the first time."""
        if self._root is None:
            return
        on = self.layers
        with self._client.atomic():
            self._ball.show_ball(picture.ball if "Ball" in on else None)
            self._ball.show_trail(picture.trail if "Trail" in on else _NO_PATH)
            self._ball.show_truth(picture.truth if "True ball" in on else None)
            self._ball.show_rays(picture.rays if "Rays" in on else ())
            expected = "Predictions" in on
            self._prediction.show(
                picture.before_bounce if expected else _NO_PATH,
                picture.after_bounce if expected else _NO_PATH,
                picture.bounce if expected else None,
                picture.hit if expected else None,
                plane="Hitting plane" in on,
            )
            if "Uncertainty" in on:
                self._uncertainty.show(picture.tube, picture.tube_sigmas, picture.spreads)
            else:
                self._uncertainty.show(_NO_PATH, _NO_PATH, ())
            self._racket.show(picture.racket if "Racket" in on else None)
            self._racket_target.show(picture.racket_target if "Racket target" in on else None)
            self._landing.show(
                picture.landing_target if "Landing target" in on else None,
                picture.spots if "Landing spots" in on else (),
            )
            if self._rig is not None:
                self._rig.set_visible("Cameras" in on and self._view not in self._cameras)
        if self._view == "Follow ball" and picture.ball is not None and self.visible:
            follow_viewpoint(self._client, picture.ball, FOLLOW_SHARE)

    def show_camera_pictures(self, pngs: dict[str, bytes]) -> None:
        """Event pictures in the frusta."""
        if self._rig is not None:
            self._rig.show(pngs)

    def _viewpoint(self, view: str) -> Viewpoint | None:
        if view in VIEWPOINTS:
            return VIEWPOINTS[view]
        return viewpoint_of_camera(self._cameras[view]) if view in self._cameras else None

    def _build(self) -> None:
        self._root = self._scene.add_frame(ROOT, show_axes=False, visible=False)
        add_arena(self._scene, ROOT)
        self._ball = BallActors(self._scene, ROOT, cameras=2)
        self._prediction = PredictionActors(
            self._scene, f"{ROOT}/prediction", plane_x_m=TaskConfig().stroke.hit_plane_x_m
        )
        self._uncertainty = UncertaintyActor(self._scene, f"{ROOT}/uncertainty")
        self._racket = RacketActor(self._scene, f"{ROOT}/racket")
        self._racket_target = RacketActor(self._scene, f"{ROOT}/racket-target", ghost=True)
        self._landing = LandingActors(self._scene, f"{ROOT}/landing")
        self._build_rig()

    def _build_rig(self) -> None:
        if self._rig is not None:
            self._rig.remove()
        self._rig_number += 1
        self._rig = RigActors(self._scene, f"{ROOT}/rig{self._rig_number}", self._cameras) if self._cameras else None
