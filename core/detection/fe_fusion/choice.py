"""Which one of a window's clusters is the ball."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.detection.fe_fusion.clusters import Clusters
from core.detection.fe_fusion_config import FeFusionConfig


def possible_balls(clusters: Clusters, config: FeFusionConfig) -> NDArray[np.intp]:
    """The numbers of the clusters with the events, the spread and the shape of a ball: the one with most events first.

    That one is the answer. Taking the one nearest to the last centre instead was no better on development flights.
    """
    radius = clusters.r_px
    possible = np.flatnonzero(
        (clusters.events >= config.size_min)
        & (config.radius_min_px <= radius)
        & (radius <= config.radius_max_px)
        & (clusters.elongation <= config.elongation_max)
    )
    return possible[np.argsort(-clusters.events[possible], kind="stable")]
