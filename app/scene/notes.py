"""Words in the scene: when the ball is to bounce and to be hit. They keep away from the ball."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.view_camera import ViewCamera
from core.history.rally_picture import RallyPicture

Array = NDArray[np.float64]

SIZE: Final = 0.8
CLEAR: Final = 0.10
"""A note is hidden while the ball is nearer to its place than this share of the picture's height."""
BESIDE_M: Final = np.array([0.0, -0.06, 0.0])
ABOVE_M: Final = np.array([0.0, 0.0, 0.11])
"""From what they tell of: beside the ring of the bounce, above the racket's blade."""
STILL_M: Final = 0.005
"""What is expected trembles a little; words need not."""
ROUNDED_MS: Final = 10
"""A text that changes with every picture cannot be read."""


class NoteActors:
    """The two notes in one browser's scene."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._bounce = scene.add_label(f"{name}/bounce", "", anchor="top-left", font_screen_scale=SIZE, visible=False)
        self._hit = scene.add_label(f"{name}/hit", "", anchor="bottom-center", font_screen_scale=SIZE, visible=False)
        self._places: dict[str, Array] = {}

    def show(self, picture: RallyPicture, eye: ViewCamera | None) -> None:
        """What is still to come of a moment."""
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
    return eye is None or ball is None or apart(eye, place, ball) > CLEAR
