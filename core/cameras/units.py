"""The unit of a calibration's lengths: what cannot be right at a table of 2.74 m is refused with what would be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np

from core.cameras.calibration_values import CalibrationNode, read_numbers
from core.cameras.camera import Camera
from core.errors import CalibrationError
from core.foreign_tables import METRES, Unit, length_unit
from core.geometry import make_transform

NEAREST_M: Final = 0.005
FARTHEST_M: Final = 12.0
"""Between two cameras of one rig. A field of play is 14 m long, and both see the ball within a few metres."""
ORIGIN_M: Final = 50.0
"""From a camera to the world's origin."""
LIKELY_M: Final = (0.03, 6.0)
"""Distances of two cameras that a factor may lead to."""
FACTORS: Final = (
    (1e-3, "millimetres, --calibration-unit mm"),
    (1e-2, "centimetres, --calibration-unit cm"),
    (0.0254, "inches"),
    (0.03, "squares of a board of 30 mm"),
    (1e3, "divided by 1000 once too often, --calibration-unit m"),
)
"""What lengths in files are, if not metres."""
LIKELY_SQUARE_M: Final = (0.005, 0.3)
SQUARE_KEYS: Final = ("square_size", "squareSize", "board_square_size", "square_length", "tag_size")
LARGEST_SQUARE_M: Final = 0.5
"""Longest square of a board; larger ones are in other units."""


UNIT_KEYS: Final = ("unit", "units", "length_unit", "translation_unit", "baseline_unit", "distance_unit")


def stated_unit(tree: CalibrationNode, asked: Unit) -> Unit:
    """The unit of the lengths in a file: what it says, else what the user says.

    Raises:
        CalibrationError: for a unit that is not known, or another than the user says.
    """
    key = tree.find(*UNIT_KEYS)
    value = None if key is None else tree.values[key]
    if not isinstance(value, str):
        return asked
    stated = length_unit(value)
    if stated is None or (asked not in ("m", stated)):
        expected = "m, cm or mm" if stated is None else f"{asked}, as --calibration-unit says"
        raise CalibrationError(f"{key}: another unit", expected=expected, got=repr(value[:40]), where=tree.where)
    return stated


def in_metres(cameras: Mapping[str, Camera], unit: Unit) -> dict[str, Camera]:
    """The cameras with their positions, given in a unit, in metres."""
    if unit == "m":
        return dict(cameras)
    return {
        name: replace(
            camera,
            T_world_camera=make_transform(camera.T_world_camera[:3, :3], METRES[unit] * camera.T_world_camera[:3, 3]),
        )
        for name, camera in cameras.items()
    }


def check_board_unit(tree: CalibrationNode, unit: Unit) -> None:
    """Raises CalibrationError if the squares of the board that a file states are too large for this unit.

    The poses of its cameras have the same unit; a file of one lens has no lengths.
    """
    key = tree.find(*SQUARE_KEYS)
    if key is None or tree.find("T", "translation_vector", "translation", "T_world_camera") is None:
        return
    try:
        sizes = read_numbers(tree, key) if isinstance(tree.values[key], list) else [float(str(tree.values[key]))]
    except (CalibrationError, ValueError):
        return  # nobody asked for it
    size = max(map(float, np.ravel(sizes)), default=0.0)
    if size * METRES[unit] <= LARGEST_SQUARE_M:
        return
    likely = "the lengths are counted in squares of the board" if size == 1 else likely_unit(size, LIKELY_SQUARE_M)
    raise CalibrationError(
        f"the lengths are not in {unit}: {key} says squares of {size * METRES[unit]:g} m",
        expected=f"squares of up to {LARGEST_SQUARE_M:g} m",
        where=tree.where,
        remedy=likely,
    )


def check_lengths(cameras: Mapping[str, Camera], where: object) -> None:
    """Raises CalibrationError if cameras are so far apart, so near, or so far away that the unit must be another."""
    for (first, a), (second, b) in combinations(cameras.items(), 2):
        apart_m = float(np.linalg.norm(a.position_world_m - b.position_world_m))
        if apart_m > FARTHEST_M or 0 < apart_m < NEAREST_M:
            raise CalibrationError(
                f"the baseline of {first} and {second} cannot be in metres",
                expected=f"{NEAREST_M:g} to {FARTHEST_M:g} m between two cameras",
                got=f"{apart_m:g} m apart",
                where=where,
                remedy=likely_unit(apart_m),
            )
    for name, camera in cameras.items():
        away_m = float(np.linalg.norm(camera.position_world_m))
        if away_m > ORIGIN_M:
            raise CalibrationError(
                f"the position of {name} cannot be in metres",
                expected=f"up to {ORIGIN_M:g} m from the world's origin, the middle of the table",
                got=f"{away_m:g} m",
                where=where,
                remedy=likely_unit(away_m),
            )


def likely_unit(length: float, likely: tuple[float, float] = LIKELY_M) -> str:
    """By which factors a length that cannot be metres becomes a likely one, the likeliest first."""
    fits = [(factor, unit) for factor, unit in FACTORS if likely[0] <= length * factor <= likely[1]]
    if not fits:
        return "write lengths in metres; --calibration-unit mm reads them as millimetres"
    readings = [f"times {factor:g} it is {length * factor:.3g} m ({unit})" for factor, unit in fits]
    return "; ".join(readings)
