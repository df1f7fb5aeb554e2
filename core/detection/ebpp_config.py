"""Settings of EBPP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from core.config import check_settings, setting
from core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class EbppConfig:
    """EROS surface and circular Hough transform (Ziegler et al. 2025, arXiv 2502.00749); the numbers are ours.

    The defaults were tuned on simulated flights that no score is taken of; docs/how/detector.md has both. `votes_roi`,
    `radius_min_px` and `fresh_min` are those that `bench rivals` found: on other flights they are better with the ball
    only and with people.
    """

    kernel_px: int = setting(5, 3, 21, step=2)
    """Side of the square round an event in which the surface decays, odd."""
    decay: float = setting(0.3, 0.01, 0.99, step=0.01)
    """Share of a pixel's value left after as many events as the kernel is wide (robotology/event-driven: 0.3)."""
    support_us: int = setting(1000, 0, 50_000, step=500)
    """An event counts only if one of its eight neighbours had one so long before it, at most; 0 counts all, and recall
    falls from 1.00 to 0.90 at 5 noise events a second and pixel."""
    blur_px: int = setting(5, 1, 15, step=2)
    """Side of the Gaussian kernel before the Hough transform, odd; 1 does not blur."""
    cell_px: float = setting(1.0, 0.5, 4.0, step=0.1)
    """A cell of the Hough transform's accumulator (OpenCV's dp)."""
    canny_high: float = setting(300.0, 10.0, 1000.0, step=5.0)
    """Upper threshold of the Canny edges that vote (OpenCV's param1), the lower one is half of it. Lone pixels of noise
    stay below 300 once they are blurred; at 200 they vote, and precision falls from 0.99 to 0.93."""
    votes_full: float = setting(20.0, 2.0, 100.0, step=0.5)
    """Fewest votes for a circle on the whole sensor (OpenCV's param2)."""
    votes_roi: float = setting(12.5, 2.0, 100.0, step=0.5)
    """Fewest votes for a circle in the region of interest."""
    radius_min_px: int = setting(3, 1, 100)
    """Smallest radius of a circle."""
    radius_max_px: int = setting(20, 3, 300)
    """Largest radius of a circle."""
    fresh_min: float = setting(0.35, 0.0, 5.0, step=0.05)
    """Fewest events of the window within 3 px of a circle, per pixel of its circumference. The surface shows an edge
    long after it has stopped or left. Simulated balls of 3 to 8 m/s had 4 or more, 5 noise events a second and pixel
    give 0.06."""
    region: Literal["fixed", "scaled", "moving"] = "fixed"
    """Where the next window is searched. fixed: `roi_expand_px` to each side of the last centre. scaled: `region_radii`
    radii to each side of it, as in PUCK (Gava et al. 2022), the tracker on the same surface that EBPP's co-author
    published with code: a small ball leaves less room for other things. moving: the same square, moved on as the ball
    moved between its last two circles, so that it can be small for a fast ball."""
    roi_expand_px: float = setting(30.0, 5.0, 400.0, step=1.0)
    """Half the side of the search square around the last centre, with the region `fixed`."""
    region_radii: float = setting(3.0, 1.5, 12.0, step=0.5)
    """The same in radii of the last circle, with the region `scaled` or `moving`. PUCK has 2, and is asked more often
    than every 2 ms; a ball of 4 px/ms and 6 px moves by 1.3 radii in between."""
    misses_to_reset: int = setting(3, 1, 50)
    """Windows in a row without a circle before the whole sensor is searched again."""
    delay_us: int = setting(250, 0, 5000, step=10)
    """Delay of the sensor: the surface shows the ball this long before the end of the window."""

    def __post_init__(self) -> None:
        check_settings(self)
        for name in ("kernel_px", "blur_px"):
            if getattr(self, name) % 2 == 0:
                raise ConfigError(
                    "kernel has no middle", expected="odd", got=getattr(self, name), where=f"EbppConfig.{name}"
                )
        if self.radius_max_px <= self.radius_min_px:
            expected = f"more than radius_min_px, {self.radius_min_px}"
            raise ConfigError(
                "no radius is allowed", expected=expected, got=self.radius_max_px, where="EbppConfig.radius_max_px"
            )
