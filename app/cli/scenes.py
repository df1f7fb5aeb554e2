"""Arguments that say what simulated cameras look at."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from app.cli.arguments import flag, given, setting_flag
from core.simulation.scenes.scene import SCENES, SceneConfig, scene_named

DEFAULT = "ball"


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneArguments:
    """`--scene` and what may be changed of it."""

    scene: str | None = flag("what the cameras look at", "|".join(SCENES), DEFAULT)
    wall: float | None = flag("brightness of the walls (the scene's: 0.16 or 0.7)", "0..1")
    flicker: float | None = setting_flag(SceneConfig, "flicker", "DEPTH")
    flicker_hz: float | None = setting_flag(SceneConfig, "flicker_hz", "HZ", "its frequency")

    def config(self) -> SceneConfig:
        """The scene that was asked for.

        Raises:
            ConfigError: if there is no such scene or a value is out of bounds.
        """
        return dataclasses.replace(scene_named(self.scene or DEFAULT), **self.changes())

    def changes(self) -> dict[str, float]:
        """What of a scene was asked to be otherwise."""
        return given({"wall": self.wall, "flicker": self.flicker, "flicker_hz": self.flicker_hz})
