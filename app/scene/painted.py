"""Pictures with soft edges that lie or stand in the scene: floor, shadows, ball, backdrop. No light changes them.

What they show is painted once; shadow maps would cost a software renderer seconds a picture.
"""

from __future__ import annotations

import functools
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.table import NET_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

Rgba = NDArray[np.uint8]
Layer = NDArray[np.float64]
Rgb = tuple[int, int, int]

FLOOR_SIZE_M: Final = (15.0, 11.0)
FLOOR_PX_PER_M: Final = 64
FLOOR_RGB: Final[Rgb] = (97, 105, 120)
FLOOR_FAR_RGB: Final[Rgb] = (70, 77, 91)
GRID_M: Final = 0.5
GRID_LIGHTER: Final = 11
"""How many grey levels the lines on the floor are above it."""
TABLE_SHADOW: Final = 0.5
TABLE_SHADOW_BLUR_M: Final = 0.22
BACKDROP_TOP_RGB: Final[Rgb] = (33, 37, 46)
BACKDROP_LOW_RGB: Final[Rgb] = (66, 73, 87)

BALL_CORE_RGB: Final[Rgb] = (255, 252, 240)
BALL_RING_RGB: Final[Rgb] = (255, 122, 0)
BALL_RIM_RGB: Final[Rgb] = (24, 16, 10)
RING_TO: Final = 1.5
RIM_TO: Final = 1.75
GLOW_TO: Final = 3.4
"""In radii of the ball: core, orange ring, dark rim, glow."""
GLOW: Final = 0.40
SPRITE_PX: Final = 160
NET_RGB: Final[Rgb] = (226, 232, 240)
NET_MESH_M: Final = 0.02
NET_PX_PER_M: Final = 600
NET_CORD: Final = 0.62
NET_BETWEEN: Final = 0.20
"""How much of what is behind it a cord hides, and the net between them: from afar cords are narrower than a pixel."""
SHADOW_PX: Final = 64
SHADOW_RGB: Final[Rgb] = (4, 8, 18)


@functools.cache
def floor_picture() -> Rgba:
    """(rows, columns, 4) the ground, columns along +x and rows along -y: light in the middle, gone at its edge."""
    columns, rows = (round(size * FLOOR_PX_PER_M) for size in FLOOR_SIZE_M)
    x = (np.arange(columns) + 0.5 - columns / 2) / FLOOR_PX_PER_M
    y = (np.arange(rows) + 0.5 - rows / 2) / FLOOR_PX_PER_M
    away = np.hypot(x[None, :] / (FLOOR_SIZE_M[0] / 2), y[:, None] / (FLOOR_SIZE_M[1] / 2))
    colour = _between(FLOOR_RGB, FLOOR_FAR_RGB, _smooth(away / 0.9))
    line = np.maximum(_lines(x)[None, :], _lines(y)[:, None])
    colour = colour + (GRID_LIGHTER * line)[..., None]
    covered = _covered(x, TABLE_LENGTH_M / 2)[None, :] * _covered(y, TABLE_WIDTH_M / 2)[:, None]
    colour = colour * (1 - TABLE_SHADOW * covered)[..., None]
    painted = _rgba(colour, _smooth((1.0 - away) / 0.45))
    painted.flags.writeable = False
    return painted


def backdrop_picture() -> Rgba:
    """(128, 4, 3) what is behind everything, from dark above to the floor's far colour, for who draws by himself.

    viser's scenes have none: its background picture leaves holes behind transparent parts of pictures in the scene.
    """
    down = _smooth(np.linspace(0, 1, 128) / 0.75)
    return np.repeat(np.round(_between(BACKDROP_TOP_RGB, BACKDROP_LOW_RGB, down))[:, None], 4, axis=1).astype(np.uint8)


def shadow_picture(darkness: float) -> Rgba:
    """(SHADOW_PX, SHADOW_PX, 4) a soft round shadow, `darkness` 0 to 1 in its middle, that fills the picture."""
    away = _away(SHADOW_PX)
    return _rgba(_plain(away, SHADOW_RGB), darkness * _smooth(1.0 - away))


def ball_picture() -> Rgba:
    """(SPRITE_PX, SPRITE_PX, 4) bright core, orange ring, dark rim, glow; half its width is `GLOW_TO` radii."""
    away = GLOW_TO * _away(SPRITE_PX)
    soft = 2.2 * GLOW_TO / SPRITE_PX
    glow = GLOW * np.clip((GLOW_TO - away) / (GLOW_TO - RIM_TO), 0, 1) ** 2
    colour, alpha = _plain(away, BALL_RING_RGB), glow
    for radius, rgb, opacity in ((RIM_TO, BALL_RIM_RGB, 0.9), (RING_TO, BALL_RING_RGB, 1.0), (1.0, BALL_CORE_RGB, 1.0)):
        inside = opacity * np.clip((radius - away) / soft + 0.5, 0, 1)
        over = inside + alpha * (1 - inside)
        share = (inside / np.maximum(over, 1e-9))[..., None]
        colour, alpha = colour * (1 - share) + np.array(rgb) * share, over
    return _rgba(colour, alpha)


def ring_picture(rgb: Rgb) -> Rgba:
    """(SPRITE_PX, SPRITE_PX, 4) a thin ring of radius 1 on the scale of `ball_picture`."""
    away = GLOW_TO * _away(SPRITE_PX)
    soft = 2.2 * GLOW_TO / SPRITE_PX
    inside = np.clip((1.15 - away) / soft + 0.5, 0, 1) * np.clip((away - 0.85) / soft + 0.5, 0, 1)
    return _rgba(_plain(away, rgb), inside)


def net_picture(width_m: float) -> Rgba:
    """(rows, columns, 4) a net of this width and the net's height: a veil with cords."""
    columns, rows = round(width_m * NET_PX_PER_M), round(NET_HEIGHT_M * NET_PX_PER_M)
    x, z = ((np.arange(count) + 0.5) / NET_PX_PER_M for count in (columns, rows))
    off_x, off_z = (np.abs((at / NET_MESH_M + 0.5) % 1 - 0.5) * NET_MESH_M * NET_PX_PER_M for at in (x, z))
    cord = np.maximum(np.clip(1.4 - off_x, 0, 1)[None, :], np.clip(1.4 - off_z, 0, 1)[:, None])
    return _rgba(_plain(cord, NET_RGB), NET_BETWEEN + (NET_CORD - NET_BETWEEN) * cord)


@functools.cache
def _away(size_px: int) -> Layer:
    """(size_px, size_px) distance from the middle; 1 at the middle of each edge."""
    at = (np.arange(size_px) + 0.5) / size_px * 2 - 1
    return np.hypot(at[None, :], at[:, None])


def _smooth(share: Layer) -> Layer:
    """From 0 to 1 without a kink."""
    share = np.clip(share, 0, 1)
    return share**2 * (3 - 2 * share)


def _between(first: Rgb, second: Rgb, share: Layer) -> Layer:
    return np.array(first) * (1 - share[..., None]) + np.array(second) * share[..., None]


def _plain(like: Layer, rgb: Rgb) -> Layer:
    """(rows, columns, 3) of one colour."""
    return np.broadcast_to(np.array(rgb, np.float64), (*like.shape, 3))


def _lines(at_m: Layer) -> Layer:
    """1 on a line of the grid, 0 off it."""
    off_px = np.abs((at_m / GRID_M + 0.5) % 1 - 0.5) * GRID_M * FLOOR_PX_PER_M
    return np.clip(1.3 - off_px, 0, 1)


def _covered(at_m: Layer, half_m: float) -> Layer:
    """Share of the light that a table of this half width takes, along one axis."""
    return _smooth((half_m - np.abs(at_m)) / (2 * TABLE_SHADOW_BLUR_M) + 0.5)


def _rgba(colour: Layer, alpha: Layer) -> Rgba:
    return np.round(np.concatenate([np.clip(colour, 0, 255), 255 * np.clip(alpha, 0, 1)[..., None]], axis=2)).astype(
        np.uint8
    )
