"""Figures of a method from its results, and how much they depend on the seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from benchmarks.perception.limits import SENSOR_DELAY_US
from benchmarks.perception.results import PerceptionResult, RecordingReading, median_with_lost

Results = Sequence[PerceptionResult]
EVENT_BYTES: Final = 4
"""Of an event as the camera sends it: one 32-bit word of Prophesee's EVT 2.0. (The columns of our files have 13.)"""
READOUT_US: Final = 8300
"""From the end of an exposure to the whole picture in memory (assumed): a sensor of at most 120 pictures a second
needs so long to read one."""
FEWEST_SEEDS: Final = 3
"""For an interval over seeds; of fewer, the least and the greatest of single recordings are given."""
RESAMPLES: Final = 2000


@dataclass(frozen=True, slots=True)
class SeedRun:
    """Everything of one seed."""

    seed: int
    results: tuple[PerceptionResult, ...]
    readings: tuple[RecordingReading, ...]

    def of(self, method: str, recordings: Iterable[str] | None = None) -> list[PerceptionResult]:
        """The results of a method, of these recordings only if they are given."""
        wanted = None if recordings is None else set(recordings)
        return [one for one in self.results if one.method == method and (wanted is None or one.recording in wanted)]


class SeedEstimate(NamedTuple):
    """A figure, and between what it lies."""

    value: float
    """Mean over seeds."""
    low: float
    high: float


def ratio(part: float, whole: float) -> float:
    """nan of nothing."""
    return part / whole if whole else math.nan


def percentile(values: Iterable[Sequence[float]], percent: float) -> float:
    """Over all of them together; nan of nothing."""
    together = np.concatenate([np.asarray(one, np.float64) for one in values] or [np.empty(0)])
    return float(np.percentile(together, percent)) if len(together) else math.nan


def precision(results: Results) -> float:
    """Share of the answers that are the ball."""
    return 1 - ratio(sum(one.false for one in results), sum(one.answers for one in results))


def recall(results: Results) -> float:
    """Share of the milliseconds with a ball that have an answer."""
    return ratio(sum(one.found for one in results), sum(one.asked for one in results))


def error_mean_px(results: Results) -> float:
    """Mean error of the correct answers, px."""
    return ratio(sum(sum(one.error_px) for one in results), sum(len(one.error_px) for one in results))


def error_px(percent: float) -> Callable[[Results], float]:
    """A percentile of the errors of the right answers."""
    return lambda results: percentile((one.error_px for one in results), percent)


def point_mm(percent: float) -> Callable[[Results], float]:
    """A percentile of the errors in space."""
    return lambda results: percentile((one.point_mm for one in results), percent)


def hit_mm(percent: float) -> Callable[[Results], float]:
    """A percentile of the errors of the hitting point."""
    return lambda results: percentile((one.hit_mm for one in results), percent)


def hits_told(results: Results) -> float:
    """Share of the balls at the hitting plane with a prediction 100 ms before."""
    return ratio(sum(len(one.hit_mm) for one in results), sum(one.hits for one in results))


def bytes_per_detection(results: Results) -> float:
    """All events, or pictures, that were read, for each right answer."""
    right = sum(one.answers - one.false for one in results)
    return ratio(sum(EVENT_BYTES * one.events + one.frame_bytes for one in results), right)


def cpu_ms(percent: float) -> Callable[[Results], float]:
    """A percentile of the processor time of steps that answered."""
    return lambda results: percentile((one.cpu_ms for one in results), percent)


def latency_p50_ms(results: Results) -> float:
    """From the light to the answer: the sensor's delay, half a window of waiting for its end, the median step."""
    return sensing_ms(results, 0.5) + cpu_ms(50)(results)


def latency_p99_ms(results: Results) -> float:
    """Latency that 99 % of all events stay below: first in a window, and a slow step."""
    return sensing_ms(results, 1.0) + cpu_ms(99)(results)


def sensing_ms(results: Results, share: float) -> float:
    """From light that meets the sensor when so much of the window, or of the exposure, is still to come, until the
    detector has its input. Light that comes between two exposures is not waited for: nobody sees it.
    """
    if not results:
        return math.nan
    one = results[0]
    if one.exposure_us:
        return 1e-3 * (share * one.exposure_us + READOUT_US)
    return 1e-3 * (SENSOR_DELAY_US + share * one.window_us)


def recovery_median_ms(results: Results) -> float:
    """From a ball's appearance to its first right answer; endless if most are never found."""
    return median_with_lost([time for one in results for time in one.recovery_ms])


def never_found(results: Results) -> float:
    """Share of the appearances without any right answer."""
    times = [time for one in results for time in one.recovery_ms]
    return ratio(sum(time is None for time in times), len(times))


FIGURES: Final[dict[str, Callable[[Results], float]]] = {
    "precision": precision,
    "recall": recall,
    "error_mean_px": error_mean_px,
    "error_median_px": error_px(50),
    "error_p95_px": error_px(95),
    "point_median_mm": point_mm(50),
    "point_p95_mm": point_mm(95),
    "hit_median_mm": hit_mm(50),
    "hit_p95_mm": hit_mm(95),
    "hits_told": hits_told,
    "bytes_per_detection": bytes_per_detection,
    "cpu_p50_ms": cpu_ms(50),
    "cpu_p99_ms": cpu_ms(99),
    "latency_p50_ms": latency_p50_ms,
    "latency_p99_ms": latency_p99_ms,
    "recovery_median_ms": recovery_median_ms,
    "never_found": never_found,
}


def estimate(runs: Sequence[SeedRun], method: str, figure: Callable[[Results], float]) -> SeedEstimate:
    """A figure of a method over all recordings, with its interval as `interval` says."""
    by_seed = [figure(run.of(method)) for run in runs]
    single = [figure([one]) for run in runs for one in run.of(method)]
    low, high = interval(by_seed, single)
    return SeedEstimate(mean(by_seed), low, high)


def interval(by_seed: Sequence[float], single: Sequence[float]) -> tuple[float, float]:
    """The 95 % bootstrap interval of the mean over seeds; of fewer than three seeds, the range of single recordings."""
    known = [value for value in by_seed if not math.isnan(value)]
    if len(known) < FEWEST_SEEDS:
        spread = [value for value in single if not math.isnan(value)]
        return (min(spread), max(spread)) if spread else (math.nan, math.nan)
    if not all(map(math.isfinite, known)):
        return min(known), max(known)
    chosen = np.random.default_rng(0).integers(0, len(known), (RESAMPLES, len(known)))
    low, high = np.percentile(np.array(known)[chosen].mean(axis=1), (2.5, 97.5)).tolist()
    return low, high


def mean(values: Sequence[float]) -> float:
    """Mean of the values that are known."""
    known = [value for value in values if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan
