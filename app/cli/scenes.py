"""Arguments that say what simulated cameras look at."""

from __future__ import annotations

import argparse
import dataclasses

from core.simulation.scenes.scene import SCENES, SceneConfig, scene_named

DEFAULT = "ball"


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """`--scene` and what may be changed of it."""
    parser.add_argument("--scene", metavar="|".join(SCENES), help=f"default: {DEFAULT}")
    parser.add_argument("--wall", type=float, metavar="0..1", help="brightness of the walls (the scene's: 0.16 or 0.7)")
    parser.add_argument("--flicker", type=float, metavar="DEPTH", help="swing of all light, 0 to 0.5; much slower")
    parser.add_argument("--flicker-hz", type=float, metavar="HZ", help="its frequency (default: 100)")


def scene_of(arguments: argparse.Namespace) -> SceneConfig:
    """The scene that was asked for.

    Raises:
        ConfigError: if there is no such scene or a value is out of bounds.
    """
    return dataclasses.replace(scene_named(arguments.scene or DEFAULT), **scene_changes(arguments))


def scene_changes(arguments: argparse.Namespace) -> dict[str, float]:
    """What of a scene was asked to be otherwise."""
    changes = {"wall": arguments.wall, "flicker": arguments.flicker, "flicker_hz": arguments.flicker_hz}
    return {name: value for name, value in changes.items() if value is not None}
