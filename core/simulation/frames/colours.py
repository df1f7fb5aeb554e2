"""What colour the surfaces of a scene have for an ordinary camera, where the event cameras see one brightness only."""

from __future__ import annotations

import dataclasses
from typing import Final, Literal

from core.simulation.scenes.scene import SceneConfig

BallColour = Literal["orange", "white"]
Tint = tuple[float, float, float]
"""Red, green and blue relative to the brightness of the scene."""

TINTS: Final[dict[str, Tint]] = {
    "table": (0.35, 0.75, 2.0),
    "line": (1.0, 1.0, 1.0),
    "floor": (1.5, 0.75, 0.55),
    "wall": (0.85, 0.95, 1.15),
    "net": (1.0, 1.0, 1.0),
    "racket": (1.0, 1.0, 1.0),
}
"""A blue table on a red sports floor before a grey curtain; lines, net and racket have no colour (choice)."""
BALL_TINTS: Final[dict[BallColour, Tint]] = {"orange": (1.15, 0.55, 0.10), "white": (1.05, 1.03, 0.97)}

SKIN_TINT: Final[Tint] = (1.30, 0.95, 0.75)
CLOTH_TINTS: Final[tuple[Tint, ...]] = ((1.60, 0.60, 0.55), (0.55, 1.10, 1.35), (0.75, 1.25, 0.70))
"""Red, blue and green shirts: the rules forbid the colour of the ball."""


def tinted(brightness: float, tint: Tint, channel: int) -> float:
    """A reflectance in one colour, within what a scene allows."""
    return min(1.0, max(0.01, brightness * tint[channel]))


def coloured_scenes(scene: SceneConfig, ball: BallColour) -> tuple[SceneConfig, SceneConfig, SceneConfig]:
    """The scene in red, green and blue light."""
    tints = {**TINTS, "ball": BALL_TINTS[ball]}
    red, green, blue = (
        dataclasses.replace(
            scene,
            **{name: tinted(getattr(scene, name), tint, channel) for name, tint in tints.items()},
        )
        for channel in range(3)
    )
    return red, green, blue
