"""Settings of the refined detector."""

from __future__ import annotations

from dataclasses import dataclass

from core.config import check_settings, setting


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinedConfig:
    """The refined detector: how much motion it looks back on, and what it takes for a ball."""

    motion_px: float = setting(3.5, 1.0, 12.0, step=0.5)
    """The history of a fit, in pixels of the ball's motion: so much that both edges have moved over whole pixels."""
    history_min_us: int = setting(2000, 500, 20_000, step=100)
    """A fast ball's history is at least as long."""
    history_max_us: int = setting(16_000, 2000, 40_000, step=500)
    """A slow ball's history is at most as long: gravity bends its path."""
    delay_us: int = setting(230, 0, 5000, step=10)
    """An estimate holds for the end of the window less this. About the photoreceptor's time constant, and longer in the
    dark: one number for a sensor. 230 is that of the simulation's; `detect --json` estimates it."""
    radius_min_px: float = setting(3.0, 1.0, 100.0, step=0.5)
    """Smaller circles are noise."""
    radius_max_px: float = setting(40.0, 3.0, 300.0, step=0.5)
    """Larger ones are no ball."""
    speed_min_px_per_ms: float = setting(0.12, 0.0, 5.0, step=0.01)
    """What moves slower is not looked for."""
    speed_max_px_per_ms: float = setting(25.0, 0.5, 100.0, step=0.5)
    """Nothing is faster."""
    pace_min_per_ms: float = setting(0.038, 0.0, 1.0, step=0.001)
    """What is slower than so many of its own radii in a millisecond never becomes a ball: 0.038 is 0.76 m/s for one,
    and 3.8 m/s for a head, which is five times as large."""
    residual_px: float = setting(0.55, 0.1, 3.0, step=0.05)
    """Root mean square distance of the edge points from the circle, robustly weighted; more is no circle."""
    coverage_min: float = setting(0.55, 0.1, 1.0, step=0.05)
    """Share of the circle's sectors that have edge points."""
    points_min: int = setting(12, 5, 200)
    """Edge points of a fit, at least."""
    inside_max: float = setting(0.3, 0.0, 1.0, step=0.05)
    """Events in the inner part of the disc for each one on its rim; a ball has few, a body's part many."""
    fill_min: float = setting(0.33, 0.0, 1.0, step=0.01)
    """Edge points as a share of the pixels that both edges swept."""
    stray_max: float = setting(0.55, 0.0, 1.0, step=0.05)
    """Share of the points in the band that lie off the circle; clutter makes it large, and chance finds."""
    evidence_min: float = setting(2.0, 0.0, 6.0, step=0.5)
    """That clean fits must add up to; a dark thing needs three times as much, for a ball's shadow is one."""
    confirm_fits: int = setting(4, 1, 20)
    """Consistent fits that make a ball of something round."""
    confirm_motion_px: float = setting(1.5, 0.0, 20.0, step=0.5)
    """Distance it must have moved meanwhile to be confirmed."""
    coast_us: int = setting(12_000, 0, 100_000, step=1000)
    """A ball that is not seen is expected on its way so long."""

    def __post_init__(self) -> None:
        check_settings(self)
