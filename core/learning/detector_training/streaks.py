"""Balls drawn into a picture: a shaded disc that moves while it is exposed, in linear light."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

GAMMA: Final = 2.2
STEP_SHARE: Final = 0.25
"""Motion between two instants, in radii."""
RADII_PX: Final = (2.3, 14.0)
LONGEST: Final = 5.0
"""Most motion during an exposure, in radii."""
SHARP: Final = 0.4
"""Share of the balls that do not move."""
ORANGE: Final = (1.0, 0.48, 0.09)


@dataclass(frozen=True, slots=True, kw_only=True)
class BallStreak:
    """A ball in the middle of its exposure."""

    x_px: float
    """From the picture's corner; the middle of the first pixel is 0.5."""
    y_px: float
    r_px: float
    motion_px: tuple[float, float] = (0.0, 0.0)
    """During the exposure."""
    light: tuple[float, float, float] = ORANGE
    """Linear, where the lamps meet it squarely."""
    ambient: float = 0.65
    """Share of the light that comes from everywhere."""

    @property
    def reach_px(self) -> float:
        """Distance from its middle within which it changes pixels."""
        return self.r_px + math.hypot(*self.motion_px) / 2 + 1.0


def random_streak(side_px: int, rng: np.random.Generator) -> BallStreak:
    """A ball anywhere in a square picture: orange or white, bright or dull, sharp or blurred."""
    r = math.exp(rng.uniform(*np.log(RADII_PX)))
    length, turn = 0.0, rng.uniform(0.0, 2 * math.pi)
    if rng.random() >= SHARP:
        length = r * rng.uniform(0.0, LONGEST)
    colour = np.array(ORANGE) if rng.random() < 0.7 else np.array([1.0, 0.98, 0.93])
    light = np.clip(colour * rng.uniform(0.3, 1.0) * np.exp(rng.normal(0.0, 0.1, 3)), 0.0, 1.0)
    return BallStreak(
        x_px=float(rng.uniform(r, side_px - r)),
        y_px=float(rng.uniform(r, side_px - r)),
        r_px=r,
        motion_px=(length * math.cos(turn), length * math.sin(turn)),
        light=(float(light[0]), float(light[1]), float(light[2])),
        ambient=float(rng.uniform(0.4, 1.0)),
    )


def draw_streak(image: NDArray[np.uint8], streak: BallStreak) -> NDArray[np.uint8]:
    """The picture (h, w, 3) with the ball in it; what does not lie in the picture is left out."""
    drawn, (height, width) = image.copy(), image.shape[:2]
    reach = streak.reach_px
    x0, x1 = max(0, math.floor(streak.x_px - reach)), min(width, math.ceil(streak.x_px + reach))
    y0, y1 = max(0, math.floor(streak.y_px - reach)), min(height, math.ceil(streak.y_px + reach))
    if x1 <= x0 or y1 <= y0:
        return drawn
    y, x = np.mgrid[y0:y1, x0:x1] + 0.5
    count = max(1, math.ceil(math.hypot(*streak.motion_px) / (STEP_SHARE * streak.r_px)))
    cover, shaded = np.zeros(x.shape), np.zeros(x.shape)
    for share in (np.arange(count) + 0.5) / count - 0.5:
        off_x = x - streak.x_px - share * streak.motion_px[0]
        off_y = y - streak.y_px - share * streak.motion_px[1]
        inside = np.clip(streak.r_px - np.hypot(off_x, off_y) + 0.5, 0.0, 1.0)
        towards_lamps = np.clip(0.5 - 0.5 * off_y / streak.r_px, 0.0, 1.0)
        cover += inside / count
        shaded += inside * (streak.ambient + (1 - streak.ambient) * towards_lamps) / count
    before = (image[y0:y1, x0:x1] / 255.0) ** GAMMA
    light = before * (1 - cover[..., None]) + shaded[..., None] * np.array(streak.light)
    drawn[y0:y1, x0:x1] = np.rint(255.0 * np.clip(light, 0.0, 1.0) ** (1 / GAMMA))
    return drawn
