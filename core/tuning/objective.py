"""The objective of a search: the score of a config on both sides of the split, here against the truth.

A recording is split in time: blocks that are tuned on, and blocks that are held out. Both sides have figures; what
is maximised is one number of the first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from core.config import check_settings, setting
from core.detection import DetectorConfig, make_detector
from core.detection.window import WHOLE, EarlyEnds
from core.errors import RecordingError
from core.metrics import run_detector
from core.metrics.grid_score import GridScore, score_on_grid
from core.metrics.score import MATCH_RADIUS_PX
from core.metrics.streaming import asked_times, newest_answers
from core.recordings import Recording


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningConfig:
    """Length of the search, and the split of the recording."""

    trials: int = setting(64, 1, 100_000)
    """Number of scored configs, the start config included."""
    seed: int = setting(0, 0, 2**31 - 1)
    """Seed of the proposals: the same seed gives the same answer with any number of processes."""
    batch: int = setting(8, 1, 64)
    """Proposals that are made at once, and answered in their order: more would keep more processes busy, and learn less
    from one to the next."""
    blocks: int = setting(20, 2, 1000)
    """Blocks of time that the recording is cut into; half of them are held out."""
    gap_us: int = setting(10_000, 0, 1_000_000, step=1000)
    """At the beginning of a block so much is left out, that no flight's neighbouring windows are on both sides; but
    never more than a third of the block."""

    def __post_init__(self) -> None:
        check_settings(self)


COST_PER_PX: Final = 0.02
"""A pixel of median error is worth two points of F1: enough to decide between configs that find the same balls, and too
little to pay for losing some."""
WORST: Final = -COST_PER_PX * MATCH_RADIUS_PX
"""Score of a config that finds nothing, or that is invalid."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of one side of the split; nan where a denominator is 0."""

    precision: float
    """Share of the answers that are a ball."""
    recall: float
    """Share of the balls asked for that are found."""
    median_error_px: float
    objective: float
    """F1 of the two, less `COST_PER_PX` times the median error: at most 1, at least `WORST`."""
    balls: int
    """Times at which a ball was asked for."""


MEASURABLE_PX: Final = 0.01
"""Smallest difference of two median errors that counts: they are printed with as many digits."""


def measurably_differ(first: Figures, second: Figures) -> bool:
    """Whether the objectives of two configs on the same balls differ by more than two balls or `MEASURABLE_PX`."""
    # A missed ball of N lowers F1 by 1 / 2N.
    least = max(COST_PER_PX * MEASURABLE_PX, 1.0 / max(1, first.balls))
    return abs(second.objective - first.objective) > least


@dataclass(frozen=True, slots=True, eq=False)
class SplitScore:
    """Counts and errors of a config on both sides; they add up over cameras."""

    tuned: GridScore = field(default_factory=GridScore)
    """Figures of the tuned side."""
    held_out: GridScore = field(default_factory=GridScore)
    """Figures of the held-out side."""

    def __add__(self, other: SplitScore) -> SplitScore:
        return SplitScore(self.tuned + other.tuned, self.held_out + other.held_out)


def figures_of(score: GridScore) -> Figures:
    """The figures of counts and errors."""
    hits = score.precision + score.recall
    f1 = 2 * score.precision * score.recall / hits if hits > 0 else 0.0  # nan is not above 0 either
    median = score.error_at(50)
    error = median if median < MATCH_RADIUS_PX else MATCH_RADIUS_PX  # nothing found counts as the largest error
    return Figures(score.precision, score.recall, median, f1 - COST_PER_PX * error, score.asked)


MIN_TIMES: Final = 8
"""Fewest positions of the ball for tuning and checking."""
DRAW: Final = 109
"""The draw that mixes best what comes back every two to seven blocks, of 10, 20 and 40: each part of such a period has
at least a fifth of its blocks on either side."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeBlocks:
    """Consecutive blocks; all of time belongs to one of them.

    One block of each pair of neighbours is held out; which of them was drawn once for good. Every other block would put
    the first half of each serve on one side wherever serves come at a steady pace.
    """

    starts_us: NDArray[np.int64]
    """(B,) ascending; the first block also has what is before it."""
    gaps_us: NDArray[np.int64]
    """(B,) left out at the beginning of each."""

    def tuned(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(N,) whether times (N,) are tuned on."""
        return self._kept(t_us) & ~self._in_held_out(t_us)

    def held_out(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(N,) whether times (N,) are held out."""
        return self._kept(t_us) & self._in_held_out(t_us)

    def _blocks(self, t_us: NDArray[np.int64]) -> NDArray[np.intp]:
        return np.maximum(np.searchsorted(self.starts_us, t_us, side="right") - 1, 0)

    def _kept(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        block = self._blocks(t_us)
        since_us = t_us - self.starts_us[block]
        return (since_us < 0) | (since_us >= self.gaps_us[block])

    def _in_held_out(self, t_us: NDArray[np.int64]) -> NDArray[np.bool_]:
        pairs = np.tile([False, True], (len(self.starts_us) // 2 + 1, 1))
        return np.random.default_rng(DRAW).permuted(pairs, axis=1).ravel()[self._blocks(t_us)]


def cut_blocks(ball_us: NDArray[np.int64], count: int, gap_us: int) -> TimeBlocks:
    """Blocks with equally many of the times at which a ball is known: fewer than `count` where those are few.

    Raises:
        RecordingError: if there are not enough of them.
    """
    times = np.unique(ball_us)
    if len(times) < MIN_TIMES:
        remedy = "label more of it, or take another recording"
        raise RecordingError("too few ball positions", expected=f"{MIN_TIMES} or more", got=len(times), remedy=remedy)
    count = max(2, min(count, len(times) // (MIN_TIMES // 2)))
    starts = times[np.arange(count) * len(times) // count]
    lengths = np.diff(np.append(starts, times[-1] + 1))
    gaps = np.minimum(gap_us, lengths // 3)
    gaps[0] = 0
    return TimeBlocks(starts, gaps)


Cancelled = Callable[[], bool]
ANY_SPEED: Final = (0.0, math.inf)


class TuningStoppedError(Exception):
    """The search was cancelled."""


class Objective(Protocol):
    """Scores configs on one recording: a frozen value that is sent to worker processes."""

    @property
    def path(self) -> Path:
        """The recording; each process opens it for itself."""
        ...

    def score(self, recording: Recording, config: DetectorConfig, cancelled: Cancelled) -> SplitScore:
        """The config's score.

        Raises:
            TuningStoppedError: when `cancelled()` becomes true.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TruthObjective:
    """A detector of that method runs over the whole recording, and its answers are compared with the truth."""

    path: Path
    cameras: tuple[str, ...]
    method: str
    blocks: TimeBlocks
    near_us: int
    """Twice as far an answer may be from a time that asks for it: a window of the config to start from, whatever the
    windows of a trial, which would otherwise seem better for being longer."""
    added_us: int | None = None
    """Score in time: what counts, at evenly spaced times, is the newest answer that has arrived, moved on by the
    ball's velocity, if each takes so long after the end of its window. None: each answer at its own time. What a step
    takes on this machine is not in it, or the same seed would not give the same answer."""
    ends: EarlyEnds = WHOLE
    """What ends windows early."""

    def score(self, recording: Recording, config: DetectorConfig, cancelled: Cancelled) -> SplitScore:
        """Score of all cameras together."""
        total = SplitScore()
        for name in self.cameras:
            stream = recording.cameras[name]
            truth = stream.truth
            assert truth is not None, "checked when the objective was made"
            detector = make_detector(self.method, stream.sensor, config)
            rule = self.ends.within(config.window.window_us)
            answers = run_detector(stream, detector, rule, cancelled=cancelled)
            if cancelled():
                raise TuningStoppedError
            if self.added_us is not None:
                arrival_us = answers.end_us.astype(np.float64) + self.added_us
                answers = newest_answers(answers, arrival_us, moved=True, asked_us=asked_times(answers))
            tuned, held_out = (
                score_on_grid(answers, truth, stream.sensor, ANY_SPEED, window_us=self.near_us, counts=side)
                for side in (self.blocks.tuned, self.blocks.held_out)
            )
            total += SplitScore(tuned, held_out)
        return total


def truth_objective(
    path: Path,
    recording: Recording,
    cameras: Sequence[str],
    method: str,
    start: DetectorConfig,
    config: TuningConfig | None = None,
    *,
    added_us: int | None = None,
    ends: EarlyEnds = WHOLE,
) -> TruthObjective:
    """Objective for the cameras of a recording that have the truth; with `added_us` it is one in time.

    `ends`: what ends windows early.

    Raises:
        RecordingError: if one of them knows none, or there are too few balls in it.
    """
    config = config or TuningConfig()
    times = []
    for name in cameras:
        truth = recording.cameras[name].truth
        if truth is None:
            remedy = "simulated recordings have one; a labelled recording is tuned against its labels"
            raise RecordingError("there is no ground truth to tune against", where=f"camera {name}", remedy=remedy)
        times.append(truth.t_us[truth.visible])
    blocks = cut_blocks(np.concatenate(times), config.blocks, config.gap_us)
    return TruthObjective(path, tuple(cameras), method, blocks, start.window.window_us, added_us, ends)
