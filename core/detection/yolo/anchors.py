"""Anchors of the boxes, and the fields predicted for each box."""

from __future__ import annotations

from typing import Final

ANCHORS_PX: Final = ((18.0, 26.0, 38.0), (6.0, 9.0, 13.0))
"""Sides at the two heads (strides 32 and 16), in pixels of the input. The published ones were fitted to COCO (10 to 344
px, oblong); balls are square, and 6 to 20 px across at half size, so that these are spread evenly on a scale of
ratios: no ball is more than 1.25 times as large or small as the nearest."""
FIELDS: Final = 6
"""Fields of a box: x, y, width, height, objectness, and class (there is one: a ball)."""
SCALE_XY: Final = 1.05
"""A centre may lie slightly outside its cell, so that one on its edge can be predicted (as published)."""
