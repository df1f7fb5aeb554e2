"""What the cameras look at: how bright table, net, room and ball are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from core.config import check_settings, setting
from core.errors import ConfigError

TO_LIGHT_WORLD: Final = np.array([0.15, 0.25, 1.0]) / np.linalg.norm([0.15, 0.25, 1.0])
"""Direction to the middle of the ceiling lights, a little off the vertical so that shadows are not under the ball."""
LIGHT_SIZE: Final = 0.12
"""Width of the lights as seen from the table, radians: a shadow's edge is this times the ball's height wide."""
ROOM_HALF_M: Final = (5.0, 4.0)
"""Distance of the walls from the table's centre along x and y."""
NET_TAPE_M: Final = 0.015
"""Width of the white tape on top of the net."""

ActorsName = Literal["nobody", "person", "two-persons", "rally", "head"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneConfig:
    """Reflectances, 0 black to 1 white, and the optics. Events see ratios only, so the unit of light drops out."""

    ball: float = setting(0.85, 0.01, 1.0)
    """A white or orange ball in near infrared."""
    table: float = setting(0.12, 0.01, 1.0)
    """Matt dark blue."""
    line: float = setting(0.75, 0.01, 1.0)
    """White lines."""
    floor: float = setting(0.10, 0.01, 1.0)
    """Dark sports floor."""
    wall: float = setting(0.16, 0.01, 1.0)
    """Dark curtain behind the table."""
    net: float = setting(0.06, 0.01, 1.0)
    """Cords of the net."""
    net_cover: float = setting(0.30, 0.0, 1.0)
    """Share of the view that the cords take: 1 to 1.5 mm cords in 7 to 8 mm meshes."""
    racket: float = setting(0.04, 0.005, 1.0)
    """Black rubber, edge and back alike."""
    ambient: float = setting(0.65, 0.0, 1.0)
    """Share of the light that comes from everywhere; the rest comes from the lights above and shades the ball."""
    shadow: float = setting(0.35, 0.0, 0.9)
    """How much darker the table is in the middle of a sharp shadow of the ball."""
    edge_px: float = setting(1.6, 0.5, 6.0)
    """Width of an edge in the picture: the lens and the pixel's own area together."""
    flicker: float = setting(0.0, 0.0, 0.5)
    """Depth of flicker of all light, relative to its mean; lamps on the mains 0.05 to 0.5, with a good ballast 0. Every
    pixel works then: more than a hundred times slower."""
    flicker_hz: float = setting(100.0, 1.0, 1000.0)
    """Twice the mains frequency."""
    cast: ActorsName = "nobody"
    """Who moves besides ball and robot: a player at the far end; that player and somebody who walks by; two players; a
    round thing of a head's size."""

    def __post_init__(self) -> None:
        check_settings(self)


SCENES: Final[dict[str, SceneConfig]] = {
    "ball": SceneConfig(),
    "dark": SceneConfig(ball=0.04, table=0.45, line=0.8, floor=0.6, wall=0.7),
    "low-contrast": SceneConfig(ball=0.55, table=0.30, line=0.7, floor=0.33, wall=0.36),
    "person": SceneConfig(cast="person"),
    "two-persons": SceneConfig(cast="two-persons"),
    "rally": SceneConfig(cast="rally"),
    "head": SceneConfig(cast="head"),
}
"""A bright ball in front of a dark room; a dark ball in front of a bright one; a ball 1.8 times
as bright as the table, so that an edge is three thresholds high where that of the first scene is ten; then the first
room with people, see `SceneConfig.cast`."""


def name_of_scene(scene: SceneConfig) -> str:
    """The name of a scene on the command line, or "custom"."""
    return next((name for name, known in SCENES.items() if known == scene), "custom")


def scene_named(name: str) -> SceneConfig:
    """A scene by its name on the command line.

    Raises:
        ConfigError: if there is no such scene.
    """
    if name not in SCENES:
        raise ConfigError(f"no scene {name!r}", expected=f"one of {', '.join(SCENES)}")
    return SCENES[name]
