"""Position of a browser's camera, and how it is set."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import viser

FOV_RAD: Final = math.radians(40)
ELSEWHERE: Final = 0.01
"""Offset that viser does not treat as equal."""


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A viewpoint in units of its scene; in the 3D scene metres of the world frame."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov_rad: float = FOV_RAD


def look(client: viser.ClientHandle, viewpoint: Viewpoint, *, near: float = 0.05, far: float = 60.0) -> None:
    """Put a browser's camera there, wherever it is.

    viser sends nothing that equals what the browser reported last, but a report may be older than what was sent since:
    so everything is set to something else first.

    Args:
        client: the browser.
        viewpoint: position, direction, lens.
        near: nearest depth that is drawn, m.
        far: farthest, m.
    """
    camera = client.camera
    with client.atomic():
        for off in (ELSEWHERE, 0.0):
            camera.fov = viewpoint.fov_rad + off
            camera.up_direction = np.array(viewpoint.up) * (1 + off)
            camera.near, camera.far = near * (1 + off), far * (1 + off)
            camera.position = np.array(viewpoint.position) + off  # before look_at: setting it moves the look-at point
            camera.look_at = np.array(viewpoint.look_at) + off
    client.flush()
