"""The soft shadow of a ball on what is below it: the higher the ball, the wider and fainter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.painted import shadow_picture
from core.table import TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]

DARKNESS: Final = (0.85, 0.6, 0.38)
"""In the shadow's middle, of a ball that is low, higher, high."""
STEPS_M: Final = (0.15, 0.4)
"""Heights between those."""
ABOVE_TABLE_M: Final = 0.0016
"""Above the lines of the table."""
ABOVE_FLOOR_M: Final = 0.004
OWN_RADII: Final = 1.7
"""Radius of the shadow of a ball on the table, in ball radii; the soft edge takes half of it."""
WIDER: Final = 0.10
"""Metres a metre of height."""


@dataclass(frozen=True, slots=True)
class Shadow:
    """A soft disc that lies on the table or on the floor."""

    x_m: float
    y_m: float
    z_m: float
    radius_m: float
    strength: int
    """Index of its darkness in `DARKNESS`."""


def shadow_of(p_world_m: Array, radius_m: float) -> Shadow:
    """The shadow of a ball (3,), drawn with `radius_m`, in light from straight above."""
    x, y, z = p_world_m.tolist()
    over_table = abs(x) <= TABLE_LENGTH_M / 2 and abs(y) <= TABLE_WIDTH_M / 2 and z >= 0
    ground = 0.0 if over_table else -TABLE_HEIGHT_M
    height = max(0.0, z - ground)
    above = ABOVE_TABLE_M if over_table else ABOVE_FLOOR_M
    strength = int(np.searchsorted(STEPS_M, height, side="right"))
    return Shadow(x, y, ground + above, OWN_RADII * radius_m + WIDER * height, strength)


class ShadowActor:
    """The shadow in one browser's scene: a picture for each darkness, of which one is shown."""

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._discs = [
            scene.add_image(
                f"{name}-{number}",
                shadow_picture(darkness),
                2.0,
                2.0,
                format="png",
                cast_shadow=False,
                receive_shadow=False,
                visible=False,
            )
            for number, darkness in enumerate(DARKNESS)
        ]

    def show(self, shadow: Shadow | None) -> None:
        """Lie there; None hides it."""
        for number, disc in enumerate(self._discs):
            disc.visible = shadow is not None and shadow.strength == number
            if shadow is not None and shadow.strength == number:
                disc.position = (shadow.x_m, shadow.y_m, shadow.z_m)
                disc.scale = round(shadow.radius_m, 3)
