"""Cluster: DBSCAN over the addresses of the events, if wanted with time as a third axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.detection.reasons import Reason
from core.errors import ConfigError
from core.events import Events


@dataclass(frozen=True, slots=True, kw_only=True)
class ClusterConfig:
    """Distance and size limits of clusters."""

    eps_px: float = setting(3.0, 1.0, 12.0, step=0.5)
    """Events within this distance are neighbours."""
    min_samples: int = setting(6, 1, 50)
    """Neighbours, itself included, that make an event the core of a cluster. After denoising 4 to 10 give the same."""
    time_scale_px_per_ms: float = setting(0.0, 0.0, 20.0, step=0.5)
    """Pixels that one millisecond counts as in the distance; 0 leaves time out."""
    size_min: int = setting(40, 1, 2000)
    """Events of the smallest cluster that is used. Simulated balls lose nothing by 40; a recording of a person
    without a ball has no answer at 40 and a few at 25."""
    size_max: int = setting(6000, 10, 200_000, step=100)
    """Events of the largest cluster that is used."""

    def __post_init__(self) -> None:
        check_settings(self)
        if self.size_max < self.size_min:
            expected = f"at least size_min, {self.size_min}"
            raise ConfigError(
                "no size is allowed", expected=expected, got=self.size_max, where="ClusterConfig.size_max"
            )


def cluster_labels(events: Events, config: ClusterConfig) -> NDArray[np.int32]:
    """(N,) number of each event's cluster, from 0; -1 for noise (paper, clustering; scikit-learn's numbering)."""
    from sklearn.cluster import DBSCAN  # imported here: it takes two seconds, and the fast path does not need it

    if not len(events):
        return np.zeros(0, np.int32)
    axes = [events.x_px.astype(np.float64), events.y_px.astype(np.float64)]
    if config.time_scale_px_per_ms > 0:
        axes.append(scaled_time(events.t_us, config.time_scale_px_per_ms))
    search = DBSCAN(eps=config.eps_px, min_samples=config.min_samples, algorithm="kd_tree")
    return search.fit(np.stack(axes, axis=1)).labels_.astype(np.int32)


def scaled_time(t_us: NDArray[np.int64], time_scale_px_per_ms: float) -> NDArray[np.float64]:
    """(N,) time since the first event in pixels."""
    return (t_us - t_us[0]) * (time_scale_px_per_ms / 1000.0)


def size_reason(size: int, config: ClusterConfig) -> Reason | None:
    """Why a cluster of this many events is rejected, or None."""
    if size < config.size_min:
        text = f"{size} events < {config.size_min}"
        return Reason("events of the cluster", "cluster.size_min", size, config.size_min, sentence=text)
    if size > config.size_max:
        text = f"{size} events > {config.size_max}"
        return Reason("events of the cluster", "cluster.size_max", size, config.size_max, sentence=text)
    return None
