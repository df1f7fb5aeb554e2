"""Augmented crops of pictures: rescaled, mirrored, with drawn balls, in other light.

Balls drawn into a picture: a shaded disc that moves while it is exposed, in linear light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.detector_training.pool import TrainingPictures
from core.detection.yolo.letterbox import GREY

DISPLAY_GAMMA: Final = 2.2
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
    before = (image[y0:y1, x0:x1] / 255.0) ** DISPLAY_GAMMA
    light = before * (1 - cover[..., None]) + shaded[..., None] * np.array(streak.light)
    drawn[y0:y1, x0:x1] = np.rint(255.0 * np.clip(light, 0.0, 1.0) ** (1 / DISPLAY_GAMMA))
    return drawn


ON_BALL: Final = 0.75
"""Share of the crops placed around a ball, if the picture has one; the others are placed anywhere."""
SCALE: Final = (0.75, 1.5)
"""Range of magnification, for more ball sizes than the cameras give."""
DRAWN: Final = 0.5
"""Share of the crops that get a drawn ball too."""
GAIN, COLOUR, GAMMA, NOISE_LEVELS, SOFT = (0.55, 1.5), 0.12, (0.8, 1.25), 5.0, 0.25
"""Variation of the light: range of the gain, spread of each colour's own, range of the tone curve's power; most noise;
share of the crops that are out of focus."""


@dataclass(frozen=True, slots=True, eq=False)
class CropBatch:
    """B crops and the balls in them."""

    images: NDArray[np.uint8]
    """(B, side, side, 3)"""
    circles: NDArray[np.float64]
    """(N, 4): number of the crop, centre (the corner is 0) and radius."""


def draw_batch(
    pool: TrainingPictures, rows: NDArray[np.int64], count: int, side_px: int, rng: np.random.Generator
) -> CropBatch:
    """Crops of pictures chosen at random among the rows (N, 2) of the pool."""
    images, circles = [], []
    for number, (group, row) in enumerate(rows[rng.integers(len(rows), size=count)].tolist()):
        pictures = pool.groups[group]
        image, balls = draw_crop(pictures.images[row], pictures.circles[row], side_px, rng)
        images.append(image)
        circles += [(float(number), *ball) for ball in balls]
    return CropBatch(np.stack(images), np.array(circles, np.float64).reshape(-1, 4))


def draw_crop(
    image: NDArray[np.uint8], circle: NDArray[np.float64], side_px: int, rng: np.random.Generator
) -> tuple[NDArray[np.uint8], list[tuple[float, float, float]]]:
    """One crop (side, side, 3) and its balls: centre and radius."""
    height, width = image.shape[:2]
    scale = float(np.exp(rng.uniform(*np.log(SCALE))))
    taken = max(8, round(side_px / scale))
    scale = side_px / taken
    has_ball = bool(np.isfinite(circle).all())
    if has_ball and rng.random() < ON_BALL:
        left, top = (int(circle[axis] - rng.uniform(0.05, 0.95) * taken) for axis in (0, 1))
    else:
        left = int(rng.integers(-taken // 8, max(1, width - taken + taken // 8)))
        top = int(rng.integers(-taken // 8, max(1, height - taken + taken // 8)))
    crop = cut(image, left, top, taken)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    crop = np.asarray(cv2.resize(crop, (side_px, side_px), interpolation=method), np.uint8)
    balls: list[tuple[float, float, float]] = []
    if has_ball:
        x, y, r = scale * (circle[0] - left), scale * (circle[1] - top), scale * circle[2]
        if 0 <= x < side_px and 0 <= y < side_px:
            balls.append((float(x), float(y), float(r)))
    if rng.random() < DRAWN:
        streak = random_streak(side_px, rng)
        if all(np.hypot(x - streak.x_px, y - streak.y_px) > r + streak.reach_px for x, y, r in balls):
            crop = draw_streak(crop, streak)
            balls.append((streak.x_px, streak.y_px, streak.r_px))
    if rng.random() < 0.5:
        crop = crop[:, ::-1]
        balls = [(side_px - x, y, r) for x, y, r in balls]
    return other_light(crop, rng), balls


def cut(image: NDArray[np.uint8], left: int, top: int, side: int) -> NDArray[np.uint8]:
    """A square of the picture (h, w, 3), grey beyond its edges as in the network's input."""
    height, width = image.shape[:2]
    crop = np.full((side, side, 3), GREY, np.uint8)
    x0, y0, x1, y1 = max(0, left), max(0, top), min(width, left + side), min(height, top + side)
    if x1 > x0 and y1 > y0:
        crop[y0 - top : y1 - top, x0 - left : x1 - left] = image[y0:y1, x0:x1]
    return crop


def other_light(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Picture with random brightness, tint, noise and blur."""
    levels = image.astype(np.float32) / 255.0
    gain = np.exp(rng.uniform(*np.log(GAIN)) + rng.normal(0.0, COLOUR, 3)).astype(np.float32)
    levels = np.clip(levels * gain, 0.0, 1.0) ** np.float32(rng.uniform(*GAMMA))
    if rng.random() < SOFT:
        levels = np.asarray(cv2.GaussianBlur(levels, (0, 0), float(rng.uniform(0.4, 1.0))), np.float32)
    noise = rng.standard_normal(levels.shape, np.float32) * np.float32(rng.uniform(0.0, NOISE_LEVELS) / 255.0)
    return np.rint(255.0 * np.clip(levels + noise, 0.0, 1.0)).astype(np.uint8)
