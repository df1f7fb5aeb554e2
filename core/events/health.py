"""Is a recording sound? Rates and gaps from its index, polarity balance and hot pixels from samples of its events."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.events.events import Events, SensorSize, count_image


@dataclass(frozen=True, slots=True, eq=False)
class RateCurve:
    """Mean event rate in N consecutive bins."""

    t_s: NDArray[np.float64]
    """(N,) middle of each bin."""
    rate_hz: NDArray[np.float64]
    """(N,) events per second."""


def rate_curve(counts_per_ms: NDArray[np.int64], duration_us: int, *, bins: int) -> RateCurve:
    """The rate over a whole recording in at most `bins` bins of whole milliseconds.

    The last millisecond may have begun only: the last bin is as long as the recording goes on, at least half as long as
    the others.
    """
    if not len(counts_per_ms):
        return RateCurve(np.zeros(0), np.zeros(0))
    width_ms = max(1, -(-len(counts_per_ms) // bins))
    starts_ms = np.arange(0, len(counts_per_ms), width_ms)
    end_ms = min(duration_us / 1e3, float(len(counts_per_ms)))
    if len(starts_ms) > 1 and end_ms - starts_ms[-1] < width_ms / 2:
        starts_ms = starts_ms[:-1]
    edges_ms = np.append(starts_ms.astype(np.float64), max(end_ms, starts_ms[-1] + width_ms / 2))
    sums = np.add.reduceat(counts_per_ms, starts_ms)
    return RateCurve((edges_ms[:-1] + edges_ms[1:]) / 2e3, sums * 1e3 / np.diff(edges_ms))


GAP_CERTAINTY_EVENTS = 30.0
"""A silence counts as a gap when this many events were to be expected in it: chance leaves e^-30."""
SHORTEST_GAP_MS = 2
HOT_SAMPLE_SHARE = 0.5
"""A hot pixel fires in at least this share of the samples; what moves through the picture does not."""
HOT_SAMPLES_NEEDED = 8
SAMPLES = 40
SAMPLE_US = 20_000


@dataclass(frozen=True, slots=True)
class Gap:
    """A silence [start_us, end_us) that chance does not explain: data were lost or the sensor was stopped."""

    start_us: int
    end_us: int


@dataclass(frozen=True, slots=True, eq=False)
class Health:
    """What a look at one camera's stream says."""

    event_count: int
    duration_us: int
    mean_rate_hz: float
    peak_rate_hz: float
    """Highest rate over any whole millisecond."""
    on_share: float
    """Share of ON events among the sampled ones; nan without events."""
    hot_pixels_xy: NDArray[np.int64]
    """(N, 2) columns x, y; the busiest first."""
    gaps: tuple[Gap, ...]


def sample_spans(duration_us: int) -> list[tuple[int, int]]:
    """[start, end) of `SAMPLES` slices spread over a recording, each of `SAMPLE_US` or, in a short one, of its share.

    They never overlap: what passes once would be in several, and look like pixels that fire all the time.
    """
    length_us = max(min(SAMPLE_US, duration_us // SAMPLES), 1)
    starts_us = np.unique(np.linspace(0, max(duration_us - length_us, 0), SAMPLES).astype(np.int64))
    return [(int(start_us), int(start_us) + length_us) for start_us in starts_us]


def assess_health(
    counts_per_ms: NDArray[np.int64], duration_us: int, samples: Iterable[Events], sensor: SensorSize
) -> Health:
    """Health of one stream.

    Args:
        counts_per_ms: events in each millisecond of the whole recording.
        duration_us: its length.
        samples: slices as `sample_spans` gives them; hot pixels need `HOT_SAMPLES_NEEDED`.
        sensor: size of the sensor.
    """
    on_count = sample_count = slices = 0
    totals = np.zeros((sensor.height_px, sensor.width_px), np.int64)
    active_slices = np.zeros_like(totals)
    for events in samples:
        if not len(events):
            continue
        counts = count_image(events)
        totals += counts
        # A hot pixel is active in nearly every slice, a busy one where something moves only then.
        active_slices += counts > 0
        on_count += int(np.count_nonzero(events.on))
        sample_count += len(events)
        slices += 1
    total = int(counts_per_ms.sum())
    return Health(
        event_count=total,
        duration_us=duration_us,
        mean_rate_hz=total * 1e6 / duration_us if duration_us else 0.0,
        peak_rate_hz=float(counts_per_ms.max(initial=0)) * 1e3,
        on_share=on_count / sample_count if sample_count else float("nan"),
        hot_pixels_xy=_hot_pixels(totals, active_slices, slices),
        gaps=find_gaps(counts_per_ms),
    )


def find_gaps(counts_per_ms: NDArray[np.int64]) -> tuple[Gap, ...]:
    """Runs of empty milliseconds too long for the stream's mean rate."""
    total = int(counts_per_ms.sum())
    if not total:
        return ()
    shortest_ms = max(SHORTEST_GAP_MS, GAP_CERTAINTY_EVENTS * len(counts_per_ms) / total)
    empty = np.concatenate([[False], counts_per_ms == 0, [False]])
    edges = np.flatnonzero(empty[1:] != empty[:-1])
    runs = zip(edges[0::2], edges[1::2], strict=True)
    return tuple(Gap(int(start) * 1000, int(end) * 1000) for start, end in runs if end - start >= shortest_ms)


def _hot_pixels(totals: NDArray[np.int64], active_slices: NDArray[np.int64], slices: int) -> NDArray[np.int64]:
    if slices < HOT_SAMPLES_NEEDED:
        return np.zeros((0, 2), np.int64)
    ys, xs = np.nonzero(active_slices >= HOT_SAMPLE_SHARE * slices)
    busiest_first = np.argsort(-totals[ys, xs], kind="stable")
    return np.stack([xs, ys], axis=1)[busiest_first]
