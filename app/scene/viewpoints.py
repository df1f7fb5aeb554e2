"""From where the 3D scene is looked at."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, Literal

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from app.scene.rig import vertical_fov_rad
from app.views.viewpoint import Viewpoint
from core.cameras import Camera
from core.geometry import look_at
from core.history.rally_picture import People
from core.table import NET_HEIGHT_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

MARGIN: Final = 0.06
"""Share of the picture's width and height that stays free on each side."""
Array = NDArray[np.float64]
View = Literal["Broadcast", "Side", "Top", "Robot", "Follow ball"]


VIEWPOINTS: Final[dict[str, Viewpoint]] = {
    "Broadcast": Viewpoint((-4.4, -3.4, 2.7), (0.0, 0.0, 0.0), fov_rad=math.radians(33)),
    "Side": Viewpoint((-0.1, -6.0, 1.5), (-0.1, 0.0, 0.15)),
    "Top": Viewpoint((0.0, -0.01, 6.2), (0.0, 0.0, 0.0)),
    "Robot": Viewpoint((-3.6, -0.5, 1.1), (0.4, 0.0, 0.1)),
    "Follow ball": Viewpoint((-2.2, -2.4, 1.3), (0.0, 0.0, 0.2)),
}
BROADCAST_DEG: Final = (26.0, 46.0)
"""From the table's length to the direction in which one looks, in a view that is high and in one that is wide: behind
the robot, so that racket, bounce and net are in front, and past the cameras at the table's sides."""
BROADCAST_ASPECTS: Final = (0.8, 1.5)
FRAMED: Final = frozenset({"Broadcast", "Side", "Top", "Robot"})
"""Only their direction counts: they stand where all of `STAGE` is in the picture."""
STAGE: Final = np.array(
    [
        *(
            (x, y, 0.0)
            for x in (-TABLE_LENGTH_M / 2, TABLE_LENGTH_M / 2)
            for y in (-TABLE_WIDTH_M / 2, TABLE_WIDTH_M / 2)
        ),
        *((x, y, -TABLE_HEIGHT_M) for x in (-1.1, 1.1) for y in (-0.62, 0.62)),
        *((0.0, y, NET_HEIGHT_M) for y in (-0.915, 0.915)),
        *((-1.72, y, z) for y in (-0.35, 0.35) for z in (0.0, 0.45)),
        *((1.3, y, 0.45) for y in (-0.3, 0.3)),
    ]
)
"""(N, 3) table with its legs and net, where the racket plays, and from where balls come."""
STANDING_M: Final = 0.15
"""So much more room persons need than they cover at one time."""
_CUBE: Final = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


def stage_with(people: People | None) -> Array:
    """(N, 3) `STAGE` with the persons who are there."""
    if people is None:
        return STAGE
    low, high = people.ends_m.min(axis=(0, 1)) - STANDING_M, people.ends_m.max(axis=(0, 1)) + STANDING_M
    low[2] = -TABLE_HEIGHT_M
    return np.concatenate([STAGE, low + _CUBE * (high - low)])


def standpoint(view: str, aspect: float, *, stage: Array = STAGE, margin: float = MARGIN) -> Viewpoint:
    """One of `VIEWPOINTS` for a picture of this width over height; of those in `FRAMED` all of `stage` is seen."""
    viewpoint = VIEWPOINTS[view]
    if view == "Broadcast":
        x, y, z = viewpoint.position
        turn = math.radians(float(np.interp(aspect, BROADCAST_ASPECTS, BROADCAST_DEG)))
        away = math.hypot(x, y)
        viewpoint = replace(viewpoint, position=(-away * math.cos(turn), -away * math.sin(turn), z))
    return framed(viewpoint, stage, aspect, margin) if view in FRAMED else viewpoint


def viewpoint_of_camera(camera: Camera) -> Viewpoint:
    """Where a camera stands, looking as it looks."""
    position, forward, down = camera.T_world_camera[:3, 3], camera.T_world_camera[:3, 2], camera.T_world_camera[:3, 1]
    return Viewpoint(
        tuple(position.tolist()),
        tuple((position + 2.0 * forward).tolist()),
        tuple((-down).tolist()),
        vertical_fov_rad(camera),
    )


def follow_viewpoint(client: viser.ClientHandle, p_world_m: Array, share: float) -> None:
    """Turn the browser's camera some way towards a point."""
    camera = client.camera
    camera.look_at = np.asarray(camera.look_at) * (1 - share) + p_world_m * share


def framed(viewpoint: Viewpoint, ps_world_m: ArrayLike, aspect: float, margin: float = MARGIN) -> Viewpoint:
    """The viewpoint moved so that the points (N, 3) just fill a picture of this width over height.

    It turns about the point of its line of sight that is nearest to what it looked at.
    """
    towards = np.subtract(viewpoint.look_at, viewpoint.position)
    right, down, forward = look_at(viewpoint.position, viewpoint.look_at)[:3, :3].T
    points = np.asarray(ps_world_m, np.float64) - viewpoint.look_at
    depth = points @ forward
    half = math.tan(viewpoint.fov_rad / 2) * (1 - 2 * margin)
    back, centre = 0.0, np.array(viewpoint.look_at)
    for axis, slope in ((right, half * aspect), (down, half)):
        # From a distance d every point must have |x - x_eye| <= slope (depth + d).
        low, high = (points @ axis + slope * depth).min(), (points @ axis - slope * depth).max()
        back = max(back, float(high - low) / (2 * slope))
        centre = centre + axis * (low + high) / 2
    distance = back / max(float(np.linalg.norm(towards)), 1e-9)
    return replace(viewpoint, position=_three(centre - distance * towards), look_at=_three(centre))


def _three(p: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = p.tolist()
    return x, y, z
