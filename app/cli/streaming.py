"""`--streaming`: scores in time, of the verbs that score a detector, as plain values and as lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from app.cli.arguments import WholeNumber, flag
from app.cli.tabulate import RecordingTable, Summary
from app.cli.terminal import say
from core.errors import CommandError
from core.events import SensorSize
from core.metrics import Score, WindowAnswers, score_answers
from core.metrics.delay import find_delay_us, without_delay
from core.metrics.run import TimedDetector
from core.metrics.streaming import (
    ADDED_US,
    FRESH_US,
    SLOWER,
    StreamingScore,
    TimedRun,
    arrival_times,
    compute_curve,
    delay_curve,
    delays_of,
)
from core.recordings import PixelTruth


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamingArguments:
    """Whether to score in time too, and what an answer takes besides computing."""

    streaming: bool = flag("score the newest answer that has arrived too: see docs/how/score-in-time.md")
    delay_us: WholeNumber | None = flag(
        "with --streaming: extra latency of each answer, such as its way to the robot", "N", "0"
    )

    def added_us(self) -> int | None:
        """The added delay of each answer, us; None without `--streaming`.

        Raises:
            CommandError: for a delay without it.
        """
        if not self.streaming and self.delay_us is not None:
            raise CommandError("a delay belongs to a score in time", where="--delay-us", remedy="add --streaming")
        return (self.delay_us or 0) if self.streaming else None


def plain_score(score: Score) -> Summary:
    """A score as values that JSON has: None for nan."""
    return _rounded(asdict(score))


def score_without_delay(answers: WindowAnswers, truth: PixelTruth | None, sensor: SensorSize) -> Summary:
    """The score with one delay of sensor and method taken out, to compare methods by; empty without truth."""
    if truth is None:
        return {}
    delay_us = find_delay_us(answers, truth, sensor)
    score = plain_score(score_answers(without_delay(answers, delay_us), truth))
    return {"score_without_delay": {"delay_us": delay_us} | score}


def with_streaming(
    table: RecordingTable,
    answers: WindowAnswers,
    truth: PixelTruth | None,
    detector: TimedDetector,
    added_us: int | None,
) -> RecordingTable:
    """A table with the score in time in its summary, if it is asked for: if `added_us` is not None."""
    if added_us is None:
        return table
    scores = streaming_summary(answers, truth, np.array(detector.seconds), added_us)
    return RecordingTable(table.text, table.summary | {"streaming": scores})


def streaming_summary(
    answers: WindowAnswers, truth: PixelTruth | None, step_s: NDArray[np.float64], added_us: int
) -> Summary:
    """The delays of a run, and, where the truth is known, its scores in time.

    Args:
        answers: what the detector said of N windows.
        truth: where the ball is.
        step_s: (N,) what each window took to compute.
        added_us: what every answer takes besides.
    """
    step_us = 1e6 * step_s
    arrival_us = arrival_times(answers.end_us, step_us, added_us)
    summary: Summary = {"added_us": added_us, "compute_us": _percentiles(step_us)}
    summary["delay_us"] = _rounded(asdict(delays_of(answers, arrival_us)))
    if truth is not None:
        run = TimedRun(answers, truth, step_us)
        added = [added_us + more for more in ADDED_US]
        summary |= _score(run.in_time(added_us))
        summary["by_added_delay"] = _rows("added_us", added, delay_curve(run, added))
        summary["by_compute_time"] = _rows("times_as_long", SLOWER, compute_curve(run, added_us))
    return summary


def say_streaming(summary: Summary) -> None:
    """Two lines of such a summary."""
    delay, held, moved = summary["delay_us"], summary.get("held"), summary.get("moved")
    assert isinstance(delay, dict)
    say(f"live: delay median {delay['median_us']}, p99 {delay['p99_us']}, worst {delay['worst_us']} us")
    if isinstance(held, dict) and isinstance(moved, dict):
        say(
            f"  newest answer {summary['age_median_us']} us old and {summary['held_median_px']} px off, "
            f"{summary['moved_median_px']} px extrapolated with its velocity (medians); recall {held['recall']} / "
            f"{moved['recall']}; "
            f"younger than {FRESH_US // 1000} ms for {summary['fresh']} of the time with a ball"
        )


def _score(score: StreamingScore) -> Summary:
    numbers = asdict(score)
    return {name: _rounded(value) if isinstance(value, dict) else _plain(value) for name, value in numbers.items()}


def _rows(name: str, values: Sequence[float], scores: Sequence[StreamingScore]) -> list[Summary]:
    """A row of each curve: what is changed, and the figures that change with it."""
    return [
        {
            name: value,
            "fresh": _plain(score.fresh),
            "age_median_us": _plain(score.age_median_us),
            "recall_held": _plain(score.held.recall),
            "recall_moved": _plain(score.moved.recall),
            "held_median_px": _plain(score.held_median_px),
            "moved_median_px": _plain(score.moved_median_px),
        }
        for value, score in zip(values, scores, strict=True)
    ]


def _percentiles(values: NDArray[np.float64]) -> Summary:
    if not len(values):
        return {"median": None, "p99": None, "worst": None}
    median, p99 = np.percentile(values, (50, 99))
    return _rounded({"median": float(median), "p99": float(p99), "worst": float(values.max())})


def _rounded(numbers: dict[str, float]) -> Summary:
    return {name: _plain(number) for name, number in numbers.items()}


def _plain(number: float) -> float | None:
    """None for nan: JSON has no such number."""
    return None if number != number else round(number, 4)
