"""The 3D scene of one browser, whole: shows a RallyPicture, with layers that can be switched off."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.arena import RacketActor, RigActors, add_arena
from app.scene.ball import BallActors, TrailActor
from app.scene.people import PeopleActor
from app.scene.prediction import LandingActors, PredictionActors, UncertaintyActor
from app.scene.view_camera import (
    FRAMED,
    STAGE,
    VIEWPOINTS,
    ViewCamera,
    camera_view,
    follow_viewpoint,
    stage_with,
    standpoint,
    view_camera_of,
    viewpoint_of_camera,
)
from app.views.viewpoint import Viewpoint, look
from core.cameras import Camera
from core.history.rally_picture import People, RallyPicture
from core.physics import TaskConfig

NOTE_SIZE: Final = 0.8
NOTE_CLEAR: Final = 0.10
"""A note is hidden while the ball is nearer to its place than this share of the picture's height."""
BESIDE_M: Final = np.array([0.0, -0.06, 0.0])
ABOVE_M: Final = np.array([0.0, 0.0, 0.11])
"""From what they tell of: beside the ring of the bounce, above the racket's blade."""
BELOW_M: Final = np.array([0.0, 0.0, -0.11])
NO_STROKE_M: Final = (-1.42, 0.0, 0.3)
"""Place of the sentence on a ball that does not come to the robot."""
STILL_M: Final = 0.005
"""What is expected trembles a little; words need not."""
ROUNDED_MS: Final = 10
"""A text that changes with every picture cannot be read."""


class NoteActors:
    """The two notes in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._bounce = scene.add_label(
            f"{name}/bounce", "", anchor="top-left", font_screen_scale=NOTE_SIZE, visible=False
        )
        self._hit = scene.add_label(
            f"{name}/hit", "", anchor="bottom-center", font_screen_scale=NOTE_SIZE, visible=False
        )
        self._no_stroke = scene.add_label(
            f"{name}/no-stroke", "", anchor="top-center", font_screen_scale=NOTE_SIZE, visible=False
        )
        self._places: dict[str, Array] = {}

    def show(self, picture: RallyPicture, eye: ViewCamera | None) -> None:
        """What is still to come of a moment, and why nothing can be done."""
        self._no_stroke.visible = bool(picture.no_stroke)
        if picture.no_stroke:
            self._no_stroke.text = picture.no_stroke
            self._no_stroke.position = NO_STROKE_M if picture.hit is None else picture.hit + BELOW_M
        notes = (
            (self._bounce, "bounce", picture.bounce, picture.bounce_in_s, BESIDE_M),
            (self._hit, "hit", picture.hit, picture.hit_in_s, ABOVE_M),
        )
        for label, word, place, left_s, above in notes:
            if place is None or left_s is None or not _is_clear(eye, place, picture.ball):
                label.visible = False
                continue
            label.visible = True
            label.text = note_text(word, left_s)
            before = self._places.get(word)
            if before is None or float(np.abs(place - before).max()) > STILL_M:
                self._places[word] = place
                label.position = place + above


def note_text(word: str, left_s: float) -> str:
    """The time that is left, rounded."""
    return f"{word} in {ROUNDED_MS * round(1e3 * left_s / ROUNDED_MS)} ms"


def apart(eye: ViewCamera, first_m: Array, second_m: Array) -> float:
    """How far from each other two points (3,) are seen, as a share of the picture's height."""
    first, second = first_m - eye.p_world_m, second_m - eye.p_world_m
    lengths = math.sqrt(float(first @ first) * float(second @ second))
    angle = math.acos(min(1.0, float(first @ second) / max(lengths, 1e-9)))
    return math.tan(min(angle, 1.5)) / (2 * math.tan(eye.fov_rad / 2))


def _is_clear(eye: ViewCamera | None, place: Array, ball: Array | None) -> bool:
    return eye is None or ball is None or apart(eye, place, ball) > NOTE_CLEAR


Array = NDArray[np.float64]

ROOT: Final = "/world"
LAYERS: Final = (
    "Ball",
    "Trail",
    "True ball",
    "Rays",
    "Predictions",
    "Uncertainty",
    "Hitting plane",
    "People",
    "Racket",
    "Racket target",
    "Landing target",
    "Landing spots",
    "Cameras",
)
FOLLOW_SHARE: Final = 0.15
MIN_RESHAPE: Final = 0.03
"""Smallest change of the view's width over height that is followed."""
SAME_PLACE_M: Final = 0.02
NOTHING: Final = RallyPicture()
_NO_PATH: Final = np.empty((0, 3))


class World:
    """Handles are made when it is first shown."""

    def __init__(self, client: viser.ClientHandle, middle_aspect: Callable[[], float] | None = None) -> None:
        """`middle_aspect` gives the width over height of what shows it; else it is what viser reports of the camera,
        which may still hold the shape from before a panel beside it came or went.
        """
        self._client = client
        self._middle_aspect = middle_aspect
        self._scene = client.scene
        self._root: viser.FrameHandle | None = None
        self._cameras: dict[str, Camera] = {}
        self._camera_views: dict[str, Camera] = {}
        """Cameras by the name of the view from each."""
        self._rig: RigActors | None = None
        self._rig_number = 0
        self._view = "Broadcast"
        self._eye: ViewCamera | None = None
        self._stands: Viewpoint | None = None
        self._aspect = 1.0
        self._stage = STAGE
        self._parts: Array | None = None
        self._persons: People | None = None
        self._touched = False
        self._drawn = RallyPicture()
        self._held: ViewCamera | None = None
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
        return (*VIEWPOINTS, *self._camera_views)

    def look_from(self, view: str) -> None:
        """Take a point of view by its name; an unknown one changes nothing."""
        viewpoint = self._viewpoint(view)
        if viewpoint is not None:
            self._view = view
            if self.visible:
                self._stand(viewpoint)

    def use_cameras(self, cameras: dict[str, Camera]) -> None:
        """Other cameras stand there."""
        if cameras == self._cameras:
            return
        self._cameras = cameras
        self._camera_views = {camera_view(name): camera for name, camera in cameras.items()}
        self._use_stage()
        if self._root is not None:
            self._build_rig()

    def draw(self, picture: RallyPicture) -> None:
        """Show a moment; nothing is drawn before the scene was shown for the first time."""
        if self._root is None:
            return
        on = self.layers
        self._make_room_for(picture.people)
        with self._client.atomic():
            self._show_ball(picture)
            self._trail.show(picture.trail if "Trail" in on else _NO_PATH, picture.trail_speeds_mps)
            self._ball.show_rays(picture.rays if "Rays" in on else ())
            expected = "Predictions" in on
            self._prediction.show(
                picture.before_bounce if expected else _NO_PATH,
                picture.after_bounce if expected else _NO_PATH,
                picture.bounce if expected else None,
                picture.hit if expected else None,
                plane="Hitting plane" in on,
            )
            self._prediction.show_places(
                picture.hit_places if expected else _NO_PATH, picture.refused_places if expected else _NO_PATH
            )
            if "Uncertainty" in on:
                self._uncertainty.show(picture.tube, picture.tube_sigmas, picture.spreads)
            else:
                self._uncertainty.show(_NO_PATH, _NO_PATH, ())
            self._notes.show(picture if expected else NOTHING, self._eye)
            self._people.show(picture.people if "People" in on else None)
            self._racket.show(picture.racket if "Racket" in on else None)
            self._racket_target.show(picture.racket_target if "Racket target" in on else None)
            self._landing.show(
                picture.landing_target if "Landing target" in on else None,
                picture.spots if "Landing spots" in on else (),
            )
            if self._rig is not None:
                self._rig.set_visible("Cameras" in on and self._view not in self._camera_views)
        if self._held is None and self._view == "Follow ball" and picture.ball is not None and self.visible:
            follow_viewpoint(self._client, picture.ball, FOLLOW_SHARE)

    def hold(self, eye: ViewCamera | None) -> None:
        """Draw for this eye, wherever the browser's camera is, until None lets it go: for pictures that are kept."""
        self._held = eye

    @property
    def eye(self) -> ViewCamera:
        """From where it is drawn now."""
        return self._held or view_camera_of(self._client)

    def billboard_wxyz(self) -> None:
        """What faces the eye follows it, also while nothing else moves; to be called by the loop."""
        if self._held is not None:
            return
        if self.visible:
            self._stand_again()
        if self.visible and not view_camera_of(self._client).same_as(self._eye):
            with self._client.atomic():
                self._show_ball(self._drawn)

    def _show_ball(self, picture: RallyPicture) -> None:
        self._drawn, self._eye = picture, self.eye
        on = self.layers
        self._ball.show(picture.ball if "Ball" in on else None, picture.truth if "True ball" in on else None, self._eye)

    def touched(self) -> None:
        """A person's hand is at the picture: where the camera stands from now on is the person's choice."""
        self._touched = True

    @property
    def _aspect_now(self) -> float:
        return self._client.camera.aspect if self._middle_aspect is None else self._middle_aspect()

    def _stand(self, viewpoint: Viewpoint) -> None:
        self._stands, self._aspect, self._touched = viewpoint, self._aspect_now, False
        look(self._client, viewpoint)

    def _stand_again(self) -> None:
        """A window of another shape sees all of it again, unless a person has moved the camera meanwhile.

        Where the browser says that its camera is tells nothing: its news may be older than what it was sent.
        """
        camera, stands = self._client.camera, self._stands
        if stands is None:
            return
        if self._touched and not np.allclose(camera.position, stands.position, atol=SAME_PLACE_M):
            self._stands = None
        elif self._view in FRAMED and abs(self._aspect_now - self._aspect) > MIN_RESHAPE:
            self.look_from(self._view)

    def _make_room_for(self, people: People | None) -> None:
        """Other persons are to be seen whole, unless somebody has moved the camera."""
        parts = None if people is None else people.parts
        before = self._parts
        if (parts is None) != (before is None) or (
            parts is not None and before is not None and not np.array_equal(parts, before)
        ):
            self._parts, self._persons = parts, people
            self._use_stage()

    def _use_stage(self) -> None:
        self._stage = stage_with(self._persons, self._cameras.values())
        if self._stands is not None and self._view in FRAMED:
            self.look_from(self._view)

    def _viewpoint(self, view: str) -> Viewpoint | None:
        if view in VIEWPOINTS:
            return standpoint(view, self._aspect_now, stage=self._stage)
        return viewpoint_of_camera(self._camera_views[view]) if view in self._camera_views else None

    def _build(self) -> None:
        self._root = self._scene.add_frame(ROOT, show_axes=False, visible=False)
        add_arena(self._scene, ROOT)
        self._ball = BallActors(self._scene, ROOT)
        self._trail = TrailActor(self._scene, f"{ROOT}/trail")
        self._prediction = PredictionActors(
            self._scene, f"{ROOT}/prediction", plane_x_m=TaskConfig().stroke.hit_plane_x_m
        )
        self._uncertainty = UncertaintyActor(self._scene, f"{ROOT}/uncertainty")
        self._racket = RacketActor(self._scene, f"{ROOT}/racket")
        self._racket_target = RacketActor(self._scene, f"{ROOT}/racket-target", ghost=True)
        self._notes = NoteActors(self._scene, f"{ROOT}/notes")
        self._people = PeopleActor(self._scene, f"{ROOT}/people")
        self._landing = LandingActors(self._scene, f"{ROOT}/landing")
        self._build_rig()

    def _build_rig(self) -> None:
        if self._rig is not None:
            self._rig.remove()
        self._rig_number += 1
        self._rig = RigActors(self._scene, f"{ROOT}/rig{self._rig_number}", self._cameras) if self._cameras else None
