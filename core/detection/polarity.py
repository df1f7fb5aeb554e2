"""Polarity: keep the events of the ball's leading edge, and of those only the ones near their centroid.

The leading edge of a bright ball on a dark ground brightens pixels (ON), that of a dark ball darkens them (OFF). The
paper takes ON. `auto` decides for each cluster: the events of a leading edge lie on the side of their enclosing circle
that the edge moves to as time passes, those of a trailing edge on the other side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.detection.localise import enclosing_circle
from core.events import Events

MIN_EVENTS = 8
"""Fewer events of one polarity say nothing about their motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolarityConfig:
    """Which polarity is the ball's leading edge."""

    leading_polarity: Literal["auto", "on", "off"] = "auto"
    """on: a bright ball (the paper always). off: a dark ball. auto: decided from the data, cluster by cluster."""
    memory_ms: float = setting(40.0, 0.0, 1000.0, step=5.0)
    """auto: for how long what earlier balls showed counts. A slow ball needs several windows to show it."""
    memory_limit: float = setting(30.0, 0.0, 200.0, step=1.0)
    """auto: how strong the memory can get, so that a few clear windows can overturn it when the background changes."""
    outlier_radius_px: float = setting(28.0, 2.0, 300.0, step=0.5)
    """Leading events farther than this from their centroid are dropped. Must exceed the largest ball by some pixels:
    the centroid of a crescent lies up to two thirds of a radius off the centre."""

    def __post_init__(self) -> None:
        check_settings(self)


def addresses(events: Events) -> NDArray[np.int32]:
    """(N, 2) x and y in a type that can be subtracted."""
    return np.stack([events.x_px, events.y_px], axis=1).astype(np.int32)


def leads(edge: Events) -> float:
    """Evidence that these events, of one polarity, are a cluster's leading (above 0) or trailing (below 0) edge.

    The correlation of time with the position along the line from the centre of the enclosing circle to the centroid,
    times sqrt(N): about how many standard deviations the motion is away from none. 0 when there is nothing to go by.
    """
    if len(edge) < MIN_EVENTS:
        return 0.0
    xy = addresses(edge).astype(np.float64)
    circle = enclosing_circle(xy)
    along_u, along_v = xy.mean(axis=0) - (circle.u_px, circle.v_px)
    distance = math.hypot(along_u, along_v)
    if distance < 0.05 * circle.r_px:  # all round the circle: no side that could lead
        return 0.0
    position = ((xy[:, 0] - xy[:, 0].mean()) * along_u + (xy[:, 1] - xy[:, 1].mean()) * along_v) / distance
    time = (edge.t_us - edge.t_us[0]).astype(np.float64)
    time -= time.mean()
    spread = float(time @ time) * float(position @ position)
    return math.sqrt(len(edge)) * float(time @ position) / math.sqrt(spread) if spread > 0 else 0.0


def on_leads(evidence: float, remembered: float, config: PolarityConfig) -> bool:
    """Whether ON is the leading polarity of a cluster; without any evidence it is, as in the paper."""
    if config.leading_polarity == "auto":
        return remembered + evidence >= 0.0
    return config.leading_polarity == "on"


def remember(remembered: float, evidence: float | None, window_us: int, config: PolarityConfig) -> float:
    """The memory after a window: it fades, and the evidence of the ball that was found (None: no ball) is added."""
    if config.memory_ms == 0.0:
        return 0.0
    faded = remembered * math.exp(-window_us / (1000.0 * config.memory_ms))
    return max(-config.memory_limit, min(config.memory_limit, faded + (evidence or 0.0)))


def near_centroid(xy_px: NDArray[np.int32], config: PolarityConfig) -> NDArray[np.bool_]:
    """(N,) True for events within `outlier_radius_px` of the centroid of all of them (paper, refinement)."""
    if not len(xy_px):
        return np.zeros(0, np.bool_)
    off = xy_px - xy_px.sum(axis=0) / len(xy_px)
    return off[:, 0] ** 2 + off[:, 1] ** 2 <= config.outlier_radius_px**2
