"""Scores in time: at each moment the newest answer that has arrived counts, however old it is by then.

`core.metrics.score` compares an answer with the ball at the answer's own time. A robot cannot: when it needs the ball,
it has the newest answer that was computed and sent by then. The delay of an answer is what passes between the moment
that it is about and its arrival: the rest of the window, waiting, computing, sending. Without any delay both scores are
equal.

Scored as STARE does (Nature Communications 2026): the newest answer is held, or moved on by the ball's velocity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.window import VELOCITY_GAP_US
from core.metrics.run import WindowAnswers
from core.metrics.score import Score, judge_answers, score_answers
from core.recordings import PixelTruth

Array = NDArray[np.float64]
Times = NDArray[np.int64]
FRESH_US: Final = 20_000
"""A robot can use an answer this old; an older one counts as none in `fresh`."""
ADDED_US: Final = tuple(range(0, 20_001, 1000))
"""Further delays of the curve."""
ASKED_EVERY_US: Final = 970
"""Between times at which methods with different windows are asked alike. It divides no usual window, so that each part
of a window is asked equally often."""
SLOWER: Final = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Times as much computing of the other curve."""


@dataclass(frozen=True, slots=True)
class Delays:
    """From the moment that an answer is about to its arrival, over N answers that found a ball."""

    median_us: float
    """nan without any answer; so the others."""
    p99_us: float
    worst_us: float


@dataclass(frozen=True, slots=True)
class StreamingScore:
    """What the newest answer is worth, at the time of each answer's own ball."""

    held: Score
    """The newest answer stays where it was."""
    moved: Score
    """It is moved on by the method's own velocity, else by that of the last two answers."""
    held_median_px: float
    """Distance of the newest answer from the ball, however far, at the times with a ball at which there is one; nan
    without any. So the next three."""
    held_p95_px: float
    moved_median_px: float
    moved_p95_px: float
    fresh: float
    """Share of the times with a ball at which an answer younger than `FRESH_US` had arrived; nan without a ball."""
    age_median_us: float
    """Age of the newest answer that found a ball, at the times with a ball; nan if none ever arrived. So the next."""
    age_p95_us: float


@dataclass(frozen=True, slots=True, eq=False)
class TimedRun:
    """A detector's answers to N windows of a camera whose ball is known, and what they took to compute."""

    answers: WindowAnswers
    truth: PixelTruth
    step_us: Array
    """(N,) microseconds."""

    def score(self) -> Score:
        """Each answer at its own time."""
        return score_answers(self.answers, self.truth)

    def in_time(self, added_us: float, asked_us: Times | None = None) -> StreamingScore:
        """The newest answer, if each takes so much time besides computing; at times (A,), or at those of the answers'
        own balls.
        """
        arrival_us = arrival_times(self.answers.end_us, self.step_us, added_us)
        return score_in_time(self.answers, self.truth, arrival_us, asked_us)


def arrival_times(end_us: Times, step_us: Array, added_us: float = 0.0) -> Array:
    """(N,) when the answers to windows arrive [us].

    One window is computed after the other, none before it has ended: what takes longer than a window builds a queue.

    Args:
        end_us: (N,) ends of the windows, ascending.
        step_us: (N,) what each takes to compute [us].
        added_us: what every answer takes besides, such as its way to the robot [us].
    """
    spent = np.cumsum(step_us)
    return np.maximum.accumulate(end_us - (spent - step_us)) + spent + added_us


def asked_times(answers: WindowAnswers) -> Times:
    """Evenly spaced times while a detector ran, us: a method with long windows is asked between its answers, too."""
    ends = answers.end_us
    return np.arange(int(ends[0]), int(ends[-1]), ASKED_EVERY_US, dtype=np.int64) if len(ends) else ends


def rows_at(arrival_us: Array, asked_us: Times) -> NDArray[np.intp]:
    """(A,) row of the newest window whose answer has arrived by each time (A,); -1 for none."""
    first_us = np.minimum.accumulate(arrival_us[::-1])[::-1]  # when this answer, or a newer one, arrives
    return np.searchsorted(first_us, asked_us, side="right") - 1


def newest_rows(arrival_us: Array, asked_us: Times) -> NDArray[np.intp]:
    """(N,) row of the newest window whose answer has arrived by the time that each row asks for; -1 for none.

    No row is given an answer of a window after its own: in no system can it have arrived.

    Args:
        arrival_us: (N,) when the answers arrive, in the order of their windows.
        asked_us: (N,) a time for each.
    """
    rows = rows_at(arrival_us, asked_us)
    for row in np.flatnonzero(rows > np.arange(len(rows))):
        there = np.flatnonzero(arrival_us[: row + 1] <= asked_us[row])
        rows[row] = there[-1] if len(there) else -1
    return rows


def newest_answers(
    answers: WindowAnswers, arrival_us: Array, *, moved: bool, asked_us: Times | None = None
) -> WindowAnswers:
    """For the time of each window's answer (N,), or for given times (A,), the newest answer that has arrived by then.

    Where that one says that there is no ball, or none has arrived, there is none.

    Args:
        answers: what the detector said, with its detections if their own velocities are to be used.
        arrival_us: (N,) when each answer arrives.
        moved: whether the ball is moved on by its velocity, to where it should be by then.
        asked_us: (A,) times, ascending; None: those of the answers.
    """
    rows, asked_us, ends_us = _newest(answers, arrival_us, asked_us)
    there = rows >= 0
    place = np.where(there, [answers.u_px[rows], answers.v_px[rows], answers.r_px[rows]], np.nan)
    if moved:
        velocity = np.nan_to_num(velocities(answers)[rows].T)
        place[:2] += velocity * 1e-3 * (asked_us - answers.t_us[rows])
    extra = np.where(there, answers.extra_circles[rows], 0).astype(np.int32)
    u_px, v_px, r_px = place
    return WindowAnswers(ends_us, asked_us, u_px, v_px, r_px, extra)


def _newest(answers: WindowAnswers, arrival_us: Array, asked_us: Times | None) -> tuple[NDArray[np.intp], Times, Times]:
    """Row of the newest answer at each time, the times, and the ends of their windows."""
    if asked_us is None:
        return newest_rows(arrival_us, answers.t_us), answers.t_us, answers.end_us
    return rows_at(arrival_us, asked_us), asked_us, asked_us


def velocities(answers: WindowAnswers) -> Array:
    """(N, 2) velocity of each ball that was found [px/ms]: the method's own, else from the answer before.

    nan where neither is known.
    """
    found = np.flatnonzero(answers.detected)
    speed = np.full((len(answers.t_us), 2), np.nan)
    t_ms = 1e-3 * answers.t_us[found]
    places = np.column_stack([answers.u_px, answers.v_px])[found]
    passed = np.diff(t_ms)
    near = (passed > 0) & (passed <= 1e-3 * VELOCITY_GAP_US)
    speed[found[1:][near]] = np.diff(places, axis=0)[near] / passed[near, None]
    if len(answers.detections) == len(found):
        for row, one in zip(found, answers.detections, strict=True):
            own = getattr(one, "velocity_px_per_ms", None)
            speed[row] = speed[row] if own is None else own
    return speed


@dataclass(frozen=True, slots=True, eq=False)
class InTimeErrors:
    """The newest answer at the N times with a ball; nan where there is none."""

    age_us: Array
    """(N,) of the newest answer that found a ball."""
    held_px: Array
    """(N,) its distance from the ball if it stays where it was."""
    moved_px: Array
    """(N,) and if it is moved on by the ball's velocity."""


def errors_in_time(
    answers: WindowAnswers, truth: PixelTruth, arrival_us: Array, asked_us: Times | None = None
) -> InTimeErrors:
    """Ages and errors of the newest answers; arguments as `score_in_time`."""
    held = judge_answers(newest_answers(answers, arrival_us, moved=False, asked_us=asked_us), truth)
    moved = judge_answers(newest_answers(answers, arrival_us, moved=True, asked_us=asked_us), truth)
    ball = held.with_ball
    return InTimeErrors(ages(answers, arrival_us, asked_us)[ball], held.error_px[ball], moved.error_px[ball])


def score_in_time(
    answers: WindowAnswers, truth: PixelTruth, arrival_us: Array, asked_us: Times | None = None
) -> StreamingScore:
    """Score the newest answer at the time of each answer's own ball, or at given times.

    Args:
        answers: of N windows in order of time.
        truth: where the ball is.
        arrival_us: (N,) when each answer arrives; equal to `answers.t_us`, `held` is the score of `score_answers`.
        asked_us: (A,) times, ascending, the same for methods that are compared; None: those of the answers.
    """
    held = newest_answers(answers, arrival_us, moved=False, asked_us=asked_us)
    moved = newest_answers(answers, arrival_us, moved=True, asked_us=asked_us)
    errors = errors_in_time(answers, truth, arrival_us, asked_us)
    age_us = errors.age_us
    held_median_px, held_p95_px = _percentiles(errors.held_px, (50, 95))
    moved_median_px, moved_p95_px = _percentiles(errors.moved_px, (50, 95))
    age_median_us, age_p95_us = _percentiles(age_us, (50, 95))
    return StreamingScore(
        held=score_answers(held, truth),
        moved=score_answers(moved, truth),
        held_median_px=held_median_px,
        held_p95_px=held_p95_px,
        moved_median_px=moved_median_px,
        moved_p95_px=moved_p95_px,
        fresh=float((age_us <= FRESH_US).mean()) if len(age_us) else float("nan"),
        age_median_us=age_median_us,
        age_p95_us=age_p95_us,
    )


def ages(answers: WindowAnswers, arrival_us: Array, asked_us: Times | None = None) -> Array:
    """(N,) age of the newest answer with a ball at the time of each window's answer, or (A,) at given times [us]; nan
    before the first one.
    """
    rows, asked_us, _ = _newest(answers, arrival_us, asked_us)
    last = np.maximum.accumulate(np.where(answers.detected, np.arange(len(answers.t_us)), -1))
    last = np.where(rows >= 0, last[rows], -1)
    return np.where(last >= 0, asked_us - answers.t_us[last], np.nan)


def delays_of(answers: WindowAnswers, arrival_us: Array) -> Delays:
    """How late the answers that found a ball arrive."""
    return Delays(*_percentiles((arrival_us - answers.t_us)[answers.detected], (50, 99, 100)))


def delay_curve(run: TimedRun, added_us: Sequence[float] = ADDED_US) -> list[StreamingScore]:
    """The score with each further delay [us], over what this machine takes."""
    return [run.in_time(added) for added in added_us]


def compute_curve(run: TimedRun, added_us: float, times: Sequence[float] = SLOWER) -> list[StreamingScore]:
    """The score on a machine that takes so many times as long for each window; one too slow builds a queue."""
    return [replace(run, step_us=factor * run.step_us).in_time(added_us) for factor in times]


def after_delay(answers: WindowAnswers, used_us: Times, *, moved: bool) -> WindowAnswers:
    """Answers about earlier moments as they are used at later ones (N,): held, or moved on by the ball's velocity."""
    if not moved:
        return replace(answers, t_us=used_us)
    shift_px = np.nan_to_num(velocities(answers)) * (1e-3 * (used_us - answers.t_us))[:, None]
    return replace(answers, t_us=used_us, u_px=answers.u_px + shift_px[:, 0], v_px=answers.v_px + shift_px[:, 1])


def _percentiles(values: Array, percents: Sequence[float]) -> list[float]:
    """nan where there is no value."""
    values = values[np.isfinite(values)]
    return np.percentile(values, percents).tolist() if len(values) else [float("nan")] * len(percents)
