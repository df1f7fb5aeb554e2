"""Arguments that say what simulated cameras look at."""

from __future__ import annotations

import argparse
import dataclasses

from core.simulation.scene import SCENES, SceneConfig, scene_named


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """`--scene` and what may be changed of it."""
    parser.add_argument("--scene", default="ball", metavar="|".join(SCENES), help="default: %(default)s")
    parser.add_argument("--wall", type=float, metavar="0..1", help="brightness of the walls (the scene's: 0.16 or 0.7)")
    parser.add_argument("--flicker", type=float, metavar="DEPTH", help="swing of all light, 0 to 0.5; much slower")
    parser.add_argument("--flicker-hz", type=float, metavar="HZ", help="its frequency (default: 100)")


def scene_of(arguments: argparse.Namespace) -> SceneConfig:
    """The scene that was asked for.

    Raises:
        ConfigError: if there is no such scene or a value is out of bounds.
    """
    changes = {"wall": arguments.wall, "flicker": arguments.flicker, "flicker_hz": arguments.flicker_hz}
    scene = scene_named(arguments.scene)
    return dataclasses.replace(scene, **{name: value for name, value in changes.items() if value is not None})
