"""Colours that mean different things look different, whatever kind of colour vision one has.

Dichromats are simulated after Machado, Oliveira and Fernandes 2009 (severity 1), distances are those of OKLab.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files
from itertools import combinations

import numpy as np
import pytest

from app.pictures.palette import METHOD_RGB, PaletteIndex, palette
from app.scene.prediction import CASE_RGB

SEES = {
    "all colours": np.eye(3),
    "no red": np.array([[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]]),
    "no green": np.array([[0.3673, 0.8607, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9690]]),
    "no blue": np.array([[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]]),
}
TO_CONES = np.array([[0.4122, 0.5363, 0.0514], [0.2119, 0.6807, 0.1074], [0.0883, 0.2817, 0.6300]])
TO_LAB = np.array([[0.2105, 0.7936, -0.0041], [1.9780, -2.4286, 0.4506], [0.0259, 0.7828, -0.8087]])
LEAST = 0.09
"""Red and green of equal lightness are 0 to 0.03 apart for those who see no green."""
Colours = Mapping[str, tuple[int, int, int]]


def oklab(rgb: tuple[int, int, int], sees: np.ndarray) -> np.ndarray:
    share = np.array(rgb) / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return TO_LAB @ np.cbrt(TO_CONES @ np.clip(sees @ linear, 0.0, 1.0))


def too_alike(colours: Colours) -> list[str]:
    return [
        f"{first} and {second} for {who}: {apart:.3f}"
        for first, second in combinations(colours, 2)
        for who, sees in SEES.items()
        if (apart := float(np.linalg.norm(oklab(colours[first], sees) - oklab(colours[second], sees)))) < LEAST
    ]


def inks(*names: PaletteIndex) -> Colours:
    rgb = palette("orange / blue")
    return {ink.name: tuple(rgb[ink].tolist()) for ink in names}


def in_time_bar(*names: str) -> Colours:
    script = (files("app.web") / "page" / "timebar.js").read_text()
    found = dict(re.findall(r"(\w+): \"(#[0-9a-f]{6})\"", script))
    return {name: tuple(bytes.fromhex(found[name][1:])) for name in names}


@pytest.mark.parametrize(
    "colours",
    [
        inks(
            PaletteIndex.LABEL,
            PaletteIndex.PARTLY,
            PaletteIndex.OCCLUDED,
            PaletteIndex.OUT_OF_FRAME,
            PaletteIndex.NO_BALL,
            PaletteIndex.DRAFT,
            PaletteIndex.ASKS,
        ),
        inks(PaletteIndex.HULL, PaletteIndex.HULL_REJECTED, PaletteIndex.TRUTH, PaletteIndex.ROI),
        inks(PaletteIndex.CIRCLE, PaletteIndex.TRUTH, PaletteIndex.ROI, PaletteIndex.HULL_REJECTED),
        inks(PaletteIndex.ON, PaletteIndex.OFF),
        inks(PaletteIndex.MINE, PaletteIndex.THEIRS, PaletteIndex.ON, PaletteIndex.OFF),
        inks(PaletteIndex.MINE, PaletteIndex.THEIRS, PaletteIndex.EPIPOLAR),
        {str(method): rgb for method, rgb in METHOD_RGB.items()},
        {case.name: rgb for case, rgb in CASE_RGB.items()},
        in_time_bar("found", "missed", "false"),
        in_time_bar("visible", "partly_occluded", "occluded", "out_of_frame", "no_ball"),
    ],
    ids=[
        "label states",
        "hulls",
        "circles",
        "polarity",
        "two people",
        "two people and the ray",
        "methods",
        "cases",
        "score",
        "labels in the bar",
    ],
)
def test_what_means_different_things_looks_different(colours: Colours) -> None:
    assert too_alike(colours) == []


def test_red_and_green_of_one_lightness_would_be_found() -> None:
    assert any("no green" in each for each in too_alike({"red": (214, 80, 60), "green": (120, 140, 50)}))
