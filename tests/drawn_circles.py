"""Orange discs before plain walls, whose place is known exactly: pictures for the detector that looks at pictures."""

import numpy as np

from benchmarks.detector_training.crops import BallStreak, draw_streak
from benchmarks.detector_training.pool import LabelledPictures


def draw_circles(count: int, seed: int, side_px: int = 160) -> LabelledPictures:
    """Orange discs of r = 8 px before plain walls of any dark colour."""
    rng, images, circles = np.random.default_rng(seed), [], []
    for _ in range(count):
        wall = np.full((side_px, side_px, 3), rng.integers(20, 130, 3), np.uint8)
        x, y = rng.uniform(16, side_px - 16, 2).tolist()
        images.append(draw_streak(wall, BallStreak(x_px=x, y_px=y, r_px=8.0, light=(0.8, 0.4, 0.08))))
        circles.append((x, y, 8.0))
    return LabelledPictures(np.stack(images), np.array(circles))
