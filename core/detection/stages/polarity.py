"""Polarity: keep the events of the ball's leading edge, and of those only the ones near their centroid.

The leading edge of a bright ball on a dark ground brightens pixels (ON), that of a dark ball darkens them (OFF). The
paper takes ON. `auto` decides for each cluster from the events around it: both edges drift towards the side on which
the leading polarity lies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.events import Events

MIN_EVENTS: Final = 8
"""Fewest events of one polarity for an estimate of their motion."""
MIN_SPREAD: Final = 1e-6
"""Sums of squares below it are rounding errors: all events at one time, or no line between the polarities."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolarityConfig:
    """Which polarity is the ball's leading edge."""

    leading_polarity: Literal["auto", "on", "off"] = "auto"
    """on: a bright ball (the paper always). off: a dark ball. auto: decided from the data, cluster by cluster."""
    memory_ms: float = setting(40.0, 0.0, 1000.0, step=5.0)
    """auto: time constant of the evidence from earlier balls. A slow ball needs several windows."""
    memory_limit: float = setting(30.0, 0.0, 200.0, step=1.0)
    """auto: largest remembered evidence, so that a few clear windows can overturn it when the background changes."""
    pair_radius_px: float = setting(45.0, 2.0, 400.0, step=1.0)
    """auto: clustered events within this distance of a cluster's centroid belong to the same object. The two edges of
    the largest ball are often two clusters, more than its radius apart."""
    outlier_radius_px: float = setting(28.0, 2.0, 300.0, step=0.5)
    """Leading events farther than this from their centroid are dropped. Must exceed the largest ball by some pixels:
    the centroid of a crescent lies up to two thirds of a radius off the centre."""

    def __post_init__(self) -> None:
        check_settings(self)


def addresses(events: Events) -> NDArray[np.int32]:
    """(N, 2) x and y in a type that can be subtracted."""
    return np.stack([events.x_px, events.y_px], axis=1).astype(np.int32)


def on_evidence(around: Events) -> float:
    """Evidence that ON (above 0) or OFF (below 0) is the leading edge of what moves here, from its events.

    The correlation of time with the position along the line from the OFF to the ON centroid, both taken within each
    polarity, times sqrt(N): about how many standard deviations the motion is away from none. 0 if there is nothing to
    go by.
    """
    sides = [around.rows(around.on), around.rows(~around.on)]
    if min(len(side) for side in sides) < MIN_EVENTS:
        return 0.0
    on_u, on_v = addresses(sides[0]).mean(axis=0)
    off_u, off_v = addresses(sides[1]).mean(axis=0)
    tt = tq = qq = 0.0
    for side in sides:
        xy = addresses(side)
        position = xy[:, 0] * (on_u - off_u) + xy[:, 1] * (on_v - off_v)
        position -= position.mean()
        time = side.t_us - side.t_us.mean()
        tt, tq, qq = tt + time @ time, tq + time @ position, qq + position @ position
    return math.sqrt(len(around)) * float(tq) / math.sqrt(tt * qq) if min(tt, qq) > MIN_SPREAD else 0.0


def on_leads(evidence: float, remembered: float, config: PolarityConfig) -> bool:
    """Whether ON is the leading polarity of a cluster; without evidence ON, as in the paper."""
    if config.leading_polarity == "auto":
        return remembered + evidence >= 0.0
    return config.leading_polarity == "on"


def remember(remembered: float, evidence: float | None, window_us: int, config: PolarityConfig) -> float:
    """Remembered evidence after a window: it decays, and the evidence of the detected ball (None: no ball) is added.

    Args:
        remembered: evidence of earlier windows; positive: ON leads.
        evidence: that of this window's ball.
        window_us: its length.
        config: memory and its limit.
    """
    if config.memory_ms == 0.0:
        return 0.0
    faded = remembered * math.exp(-window_us / (1000.0 * config.memory_ms))
    return max(-config.memory_limit, min(config.memory_limit, faded + (evidence or 0.0)))


def near_centroid(xy_px: NDArray[np.int32], of_px: NDArray[np.int32], radius_px: float) -> NDArray[np.bool_]:
    """(N,) True for the addresses `xy_px` within a radius of the centroid of the addresses `of_px`."""
    if not len(of_px):
        return np.zeros(len(xy_px), np.bool_)
    off = xy_px - of_px.sum(axis=0) / len(of_px)
    return off[:, 0] ** 2 + off[:, 1] ** 2 <= radius_px**2
