"""EROS, the exponential reduced ordinal surface: an 8-bit picture of the edges that does not depend on their speed.

An event sets its pixel to 255 and lets the brighter pixels around it decay, so an edge that moves on wipes out where it
was, and one that stands still stays (Glover et al. 2021; the rule is that of robotology/event-driven).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.jit import njit

LONG_AGO_US: Final = -(1 << 60)


class ErosRule(NamedTuple):
    """How an event changes the surface."""

    kernel_px: int
    decayed: NDArray[np.uint8]
    """(256,) decayed value of each value."""
    support_us: int
    """Largest age of a neighbour's event for an event to count, us; 0 counts all."""


class ErosSurface(NamedTuple):
    """The surface and what the filter before it remembers, both with a margin that makes bounds checks superfluous."""

    values: NDArray[np.uint8]
    """(height + 2 m, width + 2 m), m = half the kernel; the margin stays 0."""
    last_us: NDArray[np.int64]
    """(height + 2, width + 2) last event of each pixel; one value if the filter is off."""


def eros_rule(kernel_px: int, decay: float, support_us: int) -> ErosRule:
    """The rule with a decay of `decay ** (1 / kernel_px)` for each event, cut off to whole numbers."""
    decayed = (np.arange(256) * decay ** (1.0 / kernel_px)).astype(np.uint8)
    return ErosRule(kernel_px, decayed, support_us)


def blank_surface(sensor: SensorSize, rule: ErosRule) -> ErosSurface:
    """Surface without any events."""
    margin = rule.kernel_px - 1
    remembered = (sensor.height_px + 2, sensor.width_px + 2) if rule.support_us else (1, 1)
    return ErosSurface(
        np.zeros((sensor.height_px + margin, sensor.width_px + margin), np.uint8),
        np.full(remembered, LONG_AGO_US, np.int64),
    )


def picture_of(surface: ErosSurface, rule: ErosRule) -> NDArray[np.uint8]:
    """(height, width) the surface without its margin, not copied."""
    half = rule.kernel_px // 2
    height, width = surface.values.shape
    return surface.values[half : height - half, half : width - half]


@njit
def update_surface(t_us, x_px, y_px, surface: ErosSurface, rule: ErosRule) -> None:
    """Update the surface with events of both polarities, in order of time."""
    values, side, half = surface.values, rule.kernel_px, rule.kernel_px // 2
    for i in range(len(t_us)):
        x, y = np.int64(x_px[i]), np.int64(y_px[i])
        if rule.support_us and not _has_support(surface.last_us, x, y, t_us[i], rule.support_us):
            continue
        before = values[y + half, x + half]
        for row in range(y, y + side):
            line = values[row, x : x + side]
            for k in range(side):
                if line[k] > before:
                    line[k] = rule.decayed[line[k]]
        values[y + half, x + half] = 255


@njit
def _has_support(last_us, x, y, t_us, support_us):
    """Whether one of the eight neighbours had a recent event; stores this event's time."""
    since = t_us - support_us
    last_us[y + 1, x + 1] = LONG_AGO_US
    found = False
    for row in range(y, y + 3):
        for column in range(x, x + 3):
            found |= last_us[row, column] >= since
    last_us[y + 1, x + 1] = t_us
    return found
