"""The score of a detector's config against the truth of a whole recording, counted as *Compare over time* counts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from app.formatting import html_text, share_text, table_row, with_dashes_explained
from core.detection import DetectorConfig
from core.detection.methods import Method, make_detector, method_config
from core.detection.window import WHOLE, EarlyEnds
from core.metrics.compare import ClassifiedRun, MethodRun, judge_run, judge_whole_run, whole_reference
from core.metrics.delay import without_delay
from core.metrics.run import TimedDetector, run_detector
from core.metrics.streaming import TimedRun, arrival_times, asked_times, newest_answers
from core.recordings import CameraStream, PixelTruth


@dataclass(frozen=True, slots=True, eq=False)
class RunScore:
    """A method over a whole recording: its answers and what they took, and what the truth says of them."""

    stream: CameraStream
    timed: TimedRun
    """Its answers with one delay taken out, as in `judged`."""
    judged: ClassifiedRun

    def recall_in_time(self, added_us: float) -> float:
        """Recall of the newest answers that have arrived, moved on by the ball's velocity."""
        run, timed = self.judged.run, self.timed
        arrival_us = arrival_times(timed.answers.end_us, timed.step_us, added_us)
        moved = replace(run, answers=newest_answers(timed.answers, arrival_us, moved=True))
        return judge_run(moved, whole_reference(self.stream, timed.truth)).recall


def score_run(
    stream: CameraStream,
    truth: PixelTruth,
    method: Method,
    config: DetectorConfig,
    *,
    ends: EarlyEnds = WHOLE,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> RunScore:
    """Run a method over a recording and compare its answers with the truth. `ends`: what ends windows early."""
    window_us = method_config(method, config).window.window_us
    detector = TimedDetector(make_detector(method, stream.sensor, config))
    answers = run_detector(stream, detector, ends.within(window_us), progress=progress, cancelled=cancelled)
    step_s = np.array(detector.seconds)
    judged = judge_whole_run(MethodRun(method, window_us, answers, step_s), stream, truth)
    return RunScore(stream, TimedRun(without_delay(answers, judged.delay_us), truth, 1e6 * step_s), judged)


def run_scores_html(rows: list[str]) -> str:
    """The table of scores."""
    titles = (
        *("", "precision", "recall", "median error", "p95", "found", "missed", "false", "delay taken out"),
        *("live: age of answer", "live recall", "live error", "live error, extrapolated"),
    )
    head = table_row(titles, "text-align:left;font-weight:500", tag="th")
    table = with_dashes_explained(f"<table style='width:100%'>{head}{''.join(rows)}</table>")
    return (
        f"<div style='font-size:12.5px;padding:4px 12px'>{table}"
        "Judged against the simulation's truth, as in Compare over time. To judge against labels use Label, Score the "
        "detector. Every millisecond with the whole ball in view for 10 ms asks for a ball, "
        "which is found within 8 px of the truth at the answer's own time, less one delay of sensor and "
        "method, which is measured and taken out. Live: the newest answer that a robot would "
        "have; its median age, its median error as it is, and extrapolated with the ball's velocity.</div>"
    )


def run_score_row(title: str, score: RunScore, added_us: float) -> str:
    """One row of the table; answers take `added_us` besides computing."""
    judged = score.judged
    in_time = score.timed.in_time(added_us, asked_times(score.timed.answers))
    found, asked = int(judged.found.sum()), len(judged.found)
    cells = (
        html_text(title),
        share_text(judged.precision),
        share_text(judged.recall),
        _pixels(judged.error_at(50)),
        _pixels(judged.error_at(95)),
        found,
        asked - found,
        int((~judged.right).sum()),
        f"{judged.delay_us} us",
        f"{1e-3 * in_time.age_median_us:.2f} ms" if math.isfinite(in_time.age_median_us) else "-",
        share_text(score.recall_in_time(added_us)),
        _pixels(in_time.held_median_px),
        _pixels(in_time.moved_median_px),
    )
    return table_row(cells)


def _pixels(value: float) -> str:
    return f"{value:.2f} px" if math.isfinite(value) else "-"
