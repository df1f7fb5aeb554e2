"""Settings of F-E Fusion."""

from __future__ import annotations

from dataclasses import dataclass

from core.config import check_settings, setting
from core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class FeFusionConfig:
    """The event part of F-E Fusion, without its neural field: one cluster's centroid and mean distance.

    Of the source are `eps_px` and `min_samples`. All other settings are ours, in place of the field that chooses among
    the clusters there.

    The defaults were tuned on simulated flights that no score is taken of; docs/how/detector.md has both.
    """

    kernel_px: int = setting(1, 1, 9, step=2)
    """Diameter of the opening that denoises the window, odd; 1 keeps every event. In windows so short 3 wipes out the
    thin edges of a slow ball: recall falls from 0.99 to 0.62."""
    eps_px: float = setting(4.0, 1.0, 12.0, step=0.5)
    """Events within this distance are neighbours."""
    min_samples: int = setting(6, 1, 50)
    """Neighbours, itself counted, that make an event the core of a cluster."""
    size_min: int = setting(120, 1, 2000, step=5)
    """Events of the smallest cluster that can be the ball. With 100 parts of a person pass; with 160 slow balls are
    lost."""
    radius_min_px: float = setting(4.0, 0.5, 100.0, step=0.5)
    """Smallest mean distance of the ball's events from their centroid."""
    radius_max_px: float = setting(20.0, 1.0, 300.0, step=0.5)
    """Largest radius of a ball."""
    elongation_max: float = setting(1.7, 1.0, 10.0, step=0.1)
    """Largest ratio of the sides of the ball's upright bounding box."""
    fresh_min: float = setting(0.15, 0.0, 1.0, step=0.01)
    """Smallest share of the cluster's events in the last third of the window. Steady motion brings a third, 0.25
    or more in simulated serves; the trail of what has left none, and its centroid is where nothing is any more."""
    roi_expand_px: float = setting(30.0, 5.0, 400.0, step=1.0)
    """Half the side of the square around the last centre, outside which events do not count."""
    misses_to_reset: int = setting(3, 1, 50)
    """Windows in a row without such a cluster before the whole sensor is searched again."""
    delay_us: int = setting(150, 0, 5000, step=10)
    """Delay of the sensor: an estimate is valid this long before the middle of its window."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.kernel_px % 2 == 0:
            raise ConfigError(
                "kernel has no middle", expected="odd", got=self.kernel_px, where="FeFusionConfig.kernel_px"
            )
        if self.radius_max_px < self.radius_min_px:
            expected = f"at least radius_min_px, {self.radius_min_px}"
            raise ConfigError(
                "no radius is allowed", expected=expected, got=self.radius_max_px, where="FeFusionConfig.radius_max_px"
            )
