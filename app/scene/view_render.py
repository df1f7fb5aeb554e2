"""The 3D view as a picture, drawn by the browser that shows it."""

from __future__ import annotations

from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.view_camera import ViewCamera
from core.errors import CommandError

WITHIN_S: Final = 60.0
BEHIND_RGB: Final = (20, 20, 20)
"""Of the page behind the scene, which has no backdrop of its own: as seen in the browser."""
GONE: Final = "the browser that draws the picture is gone"


def render_view(client: viser.ClientHandle, width_px: int, height_px: int, eye: ViewCamera) -> NDArray[np.uint8]:
    """(height, width, 3) RGB of what the scene shows now, seen by `eye`. Not to be called by the loop: it waits.

    Raises:
        CommandError: if the browser is gone, or does not answer.
    """
    try:
        pixels = client.get_render(
            height_px,
            width_px,
            wxyz=eye.wxyz,
            position=eye.p_world_m,
            fov=eye.fov_rad,
            transport_format="png",
            timeout=WITHIN_S,
        )
    except TimeoutError as error:
        remedy = "keep its window in front"
        raise CommandError(
            "the browser did not draw its view", expected=f"within {WITHIN_S:.0f} s", remedy=remedy
        ) from error
    except RuntimeError as error:
        raise CommandError(GONE) from error
    if pixels.shape[:2] != (height_px, width_px):
        got = f"{pixels.shape[1]}x{pixels.shape[0]}"
        raise CommandError("the browser drew another size", expected=f"{width_px}x{height_px}", got=got)
    return over_background(pixels)


def over_background(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3 or 4) as it is seen on the page."""
    if pixels.shape[2] == 3:
        return pixels
    alpha = pixels[..., 3:].astype(np.uint16)
    behind = np.array(BEHIND_RGB, np.uint16)
    return ((pixels[..., :3] * alpha + behind * (255 - alpha) + 127) // 255).astype(np.uint8)
