"""The colours of every picture, as one 256-entry palette: pictures are arrays of indices into it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from functools import lru_cache
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from core.detection.detector import DETECTORS
from core.detection.methods import METHODS, Method

PolarityColours = Literal["orange / blue", "red / green", "white / grey"]
POLARITY_COLOURS: Final[tuple[PolarityColours, ...]] = get_args(PolarityColours)
"""Colours of ON / OFF events."""


class PaletteIndex(IntEnum):
    """Palette entries with a name."""

    BACKGROUND = 0
    OFF = 1  # equals core.events.events.OFF_EVENT, so a polarity image is a picture already
    ON = 2
    OFF_DIM = 3
    ON_DIM = 4
    OUTSIDE = 5
    TEXT = 6
    SHADE = 7
    HULL = 8
    HULL_REJECTED = 9
    CIRCLE = 10
    ROI = 11
    TRUTH = 12
    NOISE = 13
    LABEL = 14
    DRAFT = 15
    CLUSTER = 16
    """First of CLUSTER_COLOURS entries."""
    EPIPOLAR = 28
    SIGMA = 29
    PARTLY = 30
    OCCLUDED = 31
    OUT_OF_FRAME = 32
    NO_BALL = 33
    UNCHECKED = 34
    CURSOR = 35
    ASKS = 48
    """A click that waits for an answer."""
    MINE = 49
    THEIRS = 50
    """Two people's labels of one time."""
    RAMP = 64
    """First of RAMP_COLOURS entries, dark to bright."""
    METHOD = 128
    """First of METHOD_COLOURS entries, one for each method, see `method_colour_index`."""


CLUSTER_COLOURS: Final = 12
RAMP_COLOURS: Final = 64
METHOD_COLOURS: Final = 128
METHOD_RGB: Final[Mapping[Method, tuple[int, int, int]]] = DETECTORS.view(lambda one: one.colour)
"""Colours of circles and curves where methods are compared; cyan is the truth.

Ours, the states of labels and the cases of a rally differ for the colour-blind, too, as tests/app/pictures hold.
"""

_POLARITY_RGB: Final = {
    "orange / blue": ((255, 150, 50), (80, 150, 255)),
    "red / green": ((255, 80, 80), (70, 210, 110)),
    "white / grey": ((245, 245, 245), (120, 124, 132)),
}
_NAMED_RGB: Final = {
    PaletteIndex.BACKGROUND: (20, 21, 25),
    PaletteIndex.OUTSIDE: (11, 12, 14),
    PaletteIndex.TEXT: (235, 235, 235),
    PaletteIndex.SHADE: (34, 36, 42),
    PaletteIndex.HULL: (165, 225, 40),
    PaletteIndex.HULL_REJECTED: (255, 70, 70),
    PaletteIndex.CIRCLE: (255, 225, 60),
    PaletteIndex.ROI: (200, 120, 255),
    PaletteIndex.TRUTH: (60, 230, 230),
    PaletteIndex.NOISE: (90, 92, 98),
    PaletteIndex.LABEL: (91, 255, 182),
    PaletteIndex.DRAFT: (255, 255, 70),
    PaletteIndex.EPIPOLAR: (205, 130, 255),
    PaletteIndex.SIGMA: (255, 255, 255),
    PaletteIndex.PARTLY: (220, 214, 83),
    PaletteIndex.OCCLUDED: (217, 112, 59),
    PaletteIndex.OUT_OF_FRAME: (90, 150, 230),
    PaletteIndex.NO_BALL: (150, 152, 160),
    PaletteIndex.UNCHECKED: (44, 47, 55),
    PaletteIndex.CURSOR: (250, 250, 250),
    PaletteIndex.ASKS: (234, 156, 31),
    PaletteIndex.MINE: (153, 255, 204),
    PaletteIndex.THEIRS: (230, 55, 115),
}
_CLUSTER_RGB: Final = (
    (255, 120, 90), (90, 200, 255), (170, 255, 110), (255, 120, 220), (255, 200, 80), (130, 150, 255),
    (80, 230, 190), (220, 160, 255), (230, 230, 120), (255, 150, 150), (120, 220, 120), (150, 210, 230),
)  # fmt: skip


def method_colour_index(method: Method) -> int:
    """The colour of a method."""
    return PaletteIndex.METHOD + list(METHODS).index(method) % METHOD_COLOURS


def palette(colours: PolarityColours) -> NDArray[np.uint8]:
    """(256, 3) RGB, read-only; worked out once for the methods that there are, as every picture needs it."""
    return _palette(colours, tuple((method, METHOD_RGB[method]) for method in METHODS))


@lru_cache(maxsize=8)
def _palette(colours: PolarityColours, methods: tuple[tuple[Method, tuple[int, int, int]], ...]) -> NDArray[np.uint8]:
    rgb = np.zeros((256, 3), np.uint8)
    for ink, colour in _NAMED_RGB.items():
        rgb[ink] = colour
    on, off = _POLARITY_RGB[colours]
    background = np.array(_NAMED_RGB[PaletteIndex.BACKGROUND])
    rgb[PaletteIndex.ON], rgb[PaletteIndex.OFF] = on, off
    rgb[PaletteIndex.ON_DIM] = background + 0.5 * (np.array(on) - background)
    rgb[PaletteIndex.OFF_DIM] = background + 0.5 * (np.array(off) - background)
    rgb[PaletteIndex.CLUSTER : PaletteIndex.CLUSTER + CLUSTER_COLOURS] = _CLUSTER_RGB
    for method, colour in methods:
        rgb[method_colour_index(method)] = colour
    steps = np.linspace(0.0, 1.0, RAMP_COLOURS)[:, None]
    stops = np.array([_NAMED_RGB[PaletteIndex.BACKGROUND], (150, 45, 90), (255, 140, 40), (255, 250, 210)], np.float64)
    ramp = [np.interp(steps[:, 0], np.linspace(0, 1, len(stops)), stops[:, channel]) for channel in range(3)]
    rgb[PaletteIndex.RAMP : PaletteIndex.RAMP + RAMP_COLOURS] = np.stack(ramp, axis=1)
    rgb.flags.writeable = False
    return rgb
