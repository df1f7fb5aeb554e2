"""Settings of the refined detector."""

from __future__ import annotations

from dataclasses import dataclass

from core.config import check_settings, setting


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinedConfig:
    """The refined detector: its history, and the limits of a ball."""

    motion_px: float = setting(3.5, 1.0, 12.0, step=0.5)
    """History of a fit, in pixels of the ball's motion: enough for both edges to cross whole pixels."""
    history_min_us: int = setting(2000, 500, 20_000, step=100)
    """Shortest history, for fast balls."""
    history_max_us: int = setting(16_000, 2000, 40_000, step=500)
    """Longest history, for slow balls: gravity bends their path."""
    delay_us: int = setting(230, 0, 5000, step=10)
    """An estimate holds for the end of the window less this. About the photoreceptor's time constant, and longer in the
    dark: one number for a sensor. 230 is that of the simulation's; `detect --json` estimates it."""
    radius_min_px: float = setting(3.0, 1.0, 100.0, step=0.5)
    """Smallest radius of a ball."""
    radius_max_px: float = setting(40.0, 3.0, 300.0, step=0.5)
    """Largest radius of a ball."""
    speed_min_px_per_ms: float = setting(0.12, 0.0, 5.0, step=0.01)
    """Slowest ball."""
    speed_max_px_per_ms: float = setting(25.0, 0.5, 100.0, step=0.5)
    """Fastest ball."""
    pace_min_per_ms: float = setting(0.038, 0.0, 1.0, step=0.001)
    """Slowest ball in its own radii per ms: 0.038 is 0.76 m/s for one,
    and 3.8 m/s for a head, which is five times as large."""
    residual_px: float = setting(0.55, 0.1, 3.0, step=0.05)
    """Largest root mean square distance of the edge points from the circle, robustly weighted."""
    coverage_min: float = setting(0.55, 0.1, 1.0, step=0.05)
    """Smallest share of the circle's sectors with edge points."""
    points_min: int = setting(12, 5, 200)
    """Fewest edge points of a fit."""
    inside_max: float = setting(0.3, 0.0, 1.0, step=0.05)
    """Most events inside the disc per event on its rim; a ball has few, a part of a person many."""
    fill_min: float = setting(0.33, 0.0, 1.0, step=0.01)
    """Smallest share of the pixels swept by both edges that have edge points."""
    stray_max: float = setting(0.55, 0.0, 1.0, step=0.05)
    """Largest share of outliers in the band; clutter and random fits have many."""
    evidence_min: float = setting(2.0, 0.0, 6.0, step=0.5)
    """Evidence from clean fits that confirms a ball; a dark object needs three times as much, as shadows are dark."""
    confirm_fits: int = setting(4, 1, 20)
    """Consistent fits needed to confirm a ball."""
    confirm_motion_px: float = setting(1.5, 0.0, 20.0, step=0.5)
    """Distance it must have moved meanwhile to be confirmed."""
    coast_us: int = setting(12_000, 0, 100_000, step=1000)
    """An unseen ball is predicted for this long."""

    def __post_init__(self) -> None:
        check_settings(self)
