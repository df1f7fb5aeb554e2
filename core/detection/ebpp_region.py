"""Where `ebpp` searches the next window: a square about the last circle, by one of three rules."""

from __future__ import annotations

from dataclasses import dataclass, replace

from core.detection.ebpp_config import EbppConfig
from core.detection.stages.roi import Centre, Roi, square_around


@dataclass(frozen=True, slots=True)
class FollowedCircle:
    """The last circle, and how it had moved."""

    centre_px: Centre
    r_px: float
    end_us: int
    """End of its window."""
    motion_px_per_us: Centre = (0.0, 0.0)
    """From the circle before it; 0 of the first."""
    misses: int = 0
    """Windows without a circle since then."""


def region_of(last: FollowedCircle | None, end_us: int, config: EbppConfig) -> Roi | None:
    """The region of the window that ends then; None means the whole sensor."""
    if last is None:
        return None
    if config.region == "fixed":
        return square_around(last.centre_px, config.roi_expand_px)
    (u, v), half_px = last.centre_px, config.region_radii * last.r_px
    if config.region == "moving":
        since_us = end_us - last.end_us
        u, v = u + since_us * last.motion_px_per_us[0], v + since_us * last.motion_px_per_us[1]
    return square_around((u, v), half_px)


def follow(
    last: FollowedCircle | None, circle: tuple[float, float, float] | None, end_us: int, config: EbppConfig
) -> FollowedCircle | None:
    """What is followed after the window that ends then, with this circle (u_px, v_px, r_px) or without one.

    Args:
        last: what was followed before.
        circle: (u, v, r) found in the window, px.
        end_us: end of the window.
        config: of the detector.
    """
    if circle is not None:
        u, v, r = round(circle[0], 2), round(circle[1], 2), circle[2]
        if last is None or end_us <= last.end_us:
            return FollowedCircle((u, v), r, end_us)
        since_us = end_us - last.end_us
        motion = (u - last.centre_px[0]) / since_us, (v - last.centre_px[1]) / since_us
        return FollowedCircle((u, v), r, end_us, motion)
    if last is None or last.misses + 1 >= config.misses_to_reset:
        return None
    return replace(last, misses=last.misses + 1)
