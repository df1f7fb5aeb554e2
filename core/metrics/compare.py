"""Comparison of methods over a recording: hits, misses, false answers and step time.

Methods have windows of different lengths and answers for times of their own. All are asked at the same times, those of
a `PixelReference`; an answer is right if it lies within the match radius of the reference at its own time. Against
labels each method is run at the labels and counted there, once a label, as a score on labels counts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.detection import DetectorConfig
from core.detection.methods import Method, make_detector, method_config
from core.detection.window import WHOLE, EarlyEnds
from core.events import SensorSize
from core.metrics.at_times import answers_at
from core.metrics.delay import find_delay_us, without_delay
from core.metrics.grid_score import GRID_US, askable, distance_us
from core.metrics.run import LEAD_IN_US, TimedDetector, WindowAnswers, duration_of, one_opencv_thread, run_detector
from core.metrics.score import MATCH_RADIUS_PX, statistic_of
from core.metrics.streaming import StreamingScore, arrival_times, asked_times, score_in_time
from core.recordings import CameraStream, PixelTruth

ReferenceKind = Literal["truth", "labels", "method"]
LABEL_GAP_US: Final = 20_000
"""Between labels that are no farther apart the ball is on the line between them: gravity bends the path of one 2.5 m
away by 0.2 px meanwhile (focal length 1000 px)."""
LABEL_NEAR_US: Final = 1_000
"""An isolated label is the reference for answers within this time."""


@dataclass(frozen=True, slots=True, eq=False)
class PixelReference:
    """Reference positions of the ball: known positions, times known to be without a ball, and unknown times."""

    kind: ReferenceKind
    name: str
    """Name of the reference as shown."""
    places: PixelTruth
    """Ascending samples."""
    asked_us: NDArray[np.int64]
    """(A,) ascending times at which a detector should have a ball."""

    def at(self, t_us: NDArray[np.int64]) -> tuple[PixelTruth, NDArray[np.bool_]]:
        """Positions at times (N,), and whether each is known."""
        there = self.places.at(t_us)
        if not len(self.places.t_us):
            return there, np.zeros(len(t_us), np.bool_)
        times = self.places.t_us
        inside = (times[0] <= t_us) & (t_us <= times[-1])
        if self.kind != "labels":
            return there, inside
        after = np.clip(np.searchsorted(times, t_us), 0, len(times) - 1)
        before = np.maximum(after - 1, 0)
        between = inside & ((times[after] - times[before] <= LABEL_GAP_US) | (times[after] == t_us))
        nearest = np.where(np.abs(times[after] - t_us) < np.abs(t_us - times[before]), after, before)
        beside = ~between & (np.abs(times[nearest] - t_us) <= LABEL_NEAR_US)
        u_px, v_px, r_px = (
            np.where(beside, own[nearest], np.where(between, column, np.nan))
            for own, column in (
                (self.places.u_px, there.u_px),
                (self.places.v_px, there.v_px),
                (self.places.r_px, there.r_px),
            )
        )
        visible = np.where(beside, self.places.visible[nearest], between & there.visible)
        return PixelTruth(there.t_us, u_px, v_px, r_px, visible), between | beside


def truth_reference(truth: PixelTruth, sensor: SensorSize) -> PixelReference:
    """Reference from the truth, queried every millisecond at which the whole disc has been in view for a while, see
    `askable`.
    """
    grid = np.arange(truth.t_us[0], truth.t_us[-1], GRID_US) if len(truth.t_us) else np.empty(0, np.int64)
    return PixelReference("truth", "the truth", truth, grid[askable(grid, truth, sensor)])


def labels_reference(places: PixelTruth, name: str) -> PixelReference:
    """Reference from labels that state a ball or none; each ball is queried."""
    return PixelReference("labels", name, places, places.t_us[places.visible])


def method_reference(answers: WindowAnswers, name: str) -> PixelReference:
    """Reference from the answers of a method; no answer means no ball."""
    found = answers.detected
    late_us = int(np.median((answers.end_us - answers.t_us)[found])) if found.any() else 0
    # A window without a ball stands for the instant for which it would have had one.
    t_us = np.where(found, answers.t_us, answers.end_us - late_us)
    order = np.argsort(t_us, kind="stable")
    places = PixelTruth(t_us[order], answers.u_px[order], answers.v_px[order], answers.r_px[order], found[order])
    return PixelReference("method", name, places, places.t_us[places.visible])


Array = NDArray[np.float64]
SPAN_GAP_US: Final = 20_000
"""Misses, or false answers, farther apart than this are separate intervals."""


@dataclass(frozen=True, slots=True, eq=False)
class MethodRun:
    """All answers of a method in an interval of a recording."""

    method: Method
    window_us: int
    """Length of the longest window."""
    answers: WindowAnswers
    step_s: Array
    """(N,) processor time of this thread for each window."""


@dataclass(frozen=True, slots=True)
class ErrorRun:
    """Misses or false answers in a row."""

    start_us: int
    end_us: int
    """End of the last window."""
    count: int
    look_us: int
    """The end of the window that shows the first one."""
    place_px: tuple[float, float]
    """Position of the first missed ball, or of the first false answer, px."""


@dataclass(frozen=True, slots=True, eq=False)
class ClassifiedRun:
    """A run compared with the reference: A query times, M answers at which the reference is known."""

    run: MethodRun
    asked_us: NDArray[np.int64]
    found: NDArray[np.bool_]
    """(A,) whether a right answer is within half a window, at least half a millisecond; a label's own must be right."""
    t_us: NDArray[np.int64]
    """(M,) times of the answers."""
    end_us: NDArray[np.int64]
    """(M,) ends of their windows."""
    places_px: Array
    """(M, 2) centres."""
    right: NDArray[np.bool_]
    """(M,) whether the answer is right."""
    error_px: Array
    """(M,) distance from the reference; nan where it has no ball."""
    delay_us: int = 0
    """Taken out of the answers' times, see `core.metrics.delay`; 0 against labels, which lie on the events, and against
    a method."""
    in_time: StreamingScore | None = None
    """The newest answers that a robot would have, with the delay taken out; None without a truth."""

    @property
    def recall(self) -> float:
        """Share of the query times that are found; nan without any."""
        return float(self.found.mean()) if len(self.found) else float("nan")

    @property
    def precision(self) -> float:
        """Share of the answers that are right; nan without any."""
        return float(self.right.mean()) if len(self.right) else float("nan")

    def error_at(self, percent: float) -> float:
        """Percentile of the errors of the right answers in pixels; nan without any."""
        return statistic_of(self.error_px[self.right], lambda errors: np.percentile(errors, percent))

    def step_at(self, percent: float) -> float:
        """Percentile of a step's processor time in seconds; nan without any."""
        return statistic_of(self.run.step_s, lambda steps: np.percentile(steps, percent))


@dataclass(frozen=True, slots=True, eq=False)
class CurvesOverTime:
    """Curves of a run in B bins; nan for empty bins."""

    recall: Array
    error_px: Array
    """Median error of the right answers, px."""
    step_s: Array
    """Median step time, s."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Several methods against one reference on one interval of a recording."""

    reference: PixelReference
    start_us: int
    end_us: int
    judged: tuple[ClassifiedRun, ...]


def compare_methods(
    stream: CameraStream,
    configs: Mapping[Method, DetectorConfig],
    against: PixelReference | Method,
    start_us: int,
    end_us: int,
    *,
    added_us: float = 0.0,
    ends: EarlyEnds = WHOLE,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> Comparison:
    """Run every method over [start_us, end_us) and judge it; `against` a method, its answers are what is right.

    Against the truth one delay is taken out of each method, and the newest answers are scored in time, too, if each
    takes `added_us` besides computing. `ends`: what ends windows early, of all methods but against labels, where each
    is asked for windows of its own.

    A method that is only the reference is run, and not judged, with its defaults. When `cancelled()` becomes true the
    runs are as far as they had come.
    """
    order = list(configs)
    if not isinstance(against, PixelReference) and against not in configs:
        order.append(against)
    runs: dict[Method, MethodRun] = {}
    # Times of methods are comparable only if each has one thread.
    with one_opencv_thread():
        for number, method in enumerate(order):
            config = configs.get(method) or method_config(method)

            def report(share: float, number: int = number) -> None:
                progress((number + share) / len(order))

            if isinstance(against, PixelReference) and against.kind == "labels":
                t_us = against.places.t_us[(start_us <= against.places.t_us) & (against.places.t_us < end_us)]
                runs[method] = run_method_at(stream, method, config, t_us, progress=report, cancelled=cancelled)
                continue
            runs[method] = run_method(
                stream, method, config, start_us, end_us, ends=ends, progress=report, cancelled=cancelled
            )
    if not isinstance(against, PixelReference):
        against = method_reference(runs[against].answers, against)
    reference = _within(against, start_us, end_us)
    judged = (_judge(runs[method], reference, stream.sensor, added_us) for method in configs)
    return Comparison(reference, start_us, end_us, tuple(judged))


def _judge(run: MethodRun, reference: PixelReference, sensor: SensorSize, added_us: float) -> ClassifiedRun:
    if reference.kind != "truth":
        return judge_run(run, reference)
    delay_us = find_delay_us(run.answers, reference.places, sensor)
    answers = without_delay(run.answers, delay_us)
    arrival_us = arrival_times(answers.end_us, 1e6 * run.step_s, added_us)
    in_time = score_in_time(answers, reference.places, arrival_us, asked_times(answers))
    judged = judge_run(replace(run, answers=answers), reference)
    return replace(judged, delay_us=delay_us, in_time=in_time)


def run_method(
    stream: CameraStream,
    method: Method,
    config: DetectorConfig,
    start_us: int,
    end_us: int,
    *,
    ends: EarlyEnds = WHOLE,
    progress: Callable[[float], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> MethodRun:
    """A method's answers to the windows that end in (start_us, end_us], after a lead-in that is not counted."""
    window_us = method_config(method, config).window.window_us
    first_us = max(0, start_us - LEAD_IN_US) // window_us * window_us  # the windows of a run over the whole recording
    detector = TimedDetector(make_detector(method, stream.sensor, config))
    rule = ends.within(window_us)
    run_detector(stream, detector, rule, start_us=first_us, end_us=min(first_us + LEAD_IN_US, end_us))
    detector.seconds.clear()  # its code is loaded by now, so the first step costs no more than others
    answers = run_detector(
        stream, detector, rule, start_us=first_us, end_us=end_us, progress=progress, cancelled=cancelled
    )
    mine = answers.end_us > start_us
    return MethodRun(method, window_us, answers.rows(mine), np.array(detector.seconds)[mine])


def run_method_at(
    stream: CameraStream,
    method: Method,
    config: DetectorConfig,
    t_us: NDArray[np.int64],
    *,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] | None = None,
) -> MethodRun:
    """A method's answers at the times (N,) of labels, those of `answers_at`, with the time of each one's own window.

    Args:
        stream: the camera.
        method: name of the detector.
        config: its settings.
        t_us: (N,) times, ascending.
        progress: gets the share that is done.
        cancelled: is asked before each time.
    """
    window_us = method_config(method, config).window.window_us
    detector, step_s = TimedDetector(make_detector(method, stream.sensor, config)), list[float]()

    def answered(share: float) -> None:
        step_s.append(detector.seconds[-1] if detector.seconds else 0.0)  # no window before the recording begins
        progress(share)

    answers = answers_at(stream, detector, t_us, window_us, progress=answered, cancelled=cancelled)
    return MethodRun(method, window_us, answers, np.array(step_s))


def judge_run(run: MethodRun, reference: PixelReference, *, match_radius_px: float = MATCH_RADIUS_PX) -> ClassifiedRun:
    """Compare the answers with the reference; times where it is unknown are ignored."""
    answers = run.answers.rows(run.answers.detected)
    there, known = reference.at(answers.t_us)
    error_px = np.hypot(answers.u_px - there.u_px, answers.v_px - there.v_px)
    right = known & there.visible & (np.nan_to_num(error_px, nan=np.inf) <= match_radius_px)
    nearest_us = distance_us(reference.asked_us, answers.t_us[right])
    near_us = (
        0 if reference.kind == "labels" else max(GRID_US, run.window_us) // 2
    )  # each label has an answer of its own
    return ClassifiedRun(
        run=run,
        asked_us=reference.asked_us,
        found=nearest_us <= near_us,
        t_us=answers.t_us[known],
        end_us=answers.end_us[known],
        places_px=np.column_stack([answers.u_px, answers.v_px])[known],
        right=right[known],
        error_px=error_px[known],
    )


def judge_whole_run(run: MethodRun, stream: CameraStream, truth: PixelTruth) -> ClassifiedRun:
    """Compare the answers to a whole recording with its truth, by the same rule and figures as `compare_methods`."""
    return _judge(run, whole_reference(stream, truth), stream.sensor, 0.0)


def whole_reference(stream: CameraStream, truth: PixelTruth) -> PixelReference:
    """Reference from the truth of a whole recording."""
    return _within(truth_reference(truth, stream.sensor), 0, duration_of(stream))


def bin_edges(start_us: int, end_us: int, *, most: int = 80, shortest_us: int = 10_000) -> NDArray[np.int64]:
    """(B + 1,) edges of equal bins over an interval: at most `most`, fewer if they would be too short."""
    count = max(1, min(most, (end_us - start_us) // shortest_us))
    return np.linspace(start_us, end_us, count + 1).astype(np.int64)


def curves_over_time(judged: ClassifiedRun, edges_us: NDArray[np.int64]) -> CurvesOverTime:
    """Curves of a run in the bins between the edges (B + 1,)."""
    right = judged.right
    return CurvesOverTime(
        recall=_by_bin(np.mean, judged.asked_us, judged.found.astype(np.float64), edges_us),
        error_px=_by_bin(np.median, judged.t_us[right], judged.error_px[right], edges_us),
        step_s=_by_bin(np.median, judged.run.answers.end_us - 1, judged.run.step_s, edges_us),
    )


def missed_stretches(judged: ClassifiedRun, reference: PixelReference) -> tuple[ErrorRun, ...]:
    """Runs of query times without a right answer."""
    answers = judged.run.answers
    late_us = int(np.median(judged.end_us - judged.t_us)) if len(judged.t_us) else 0
    missed = ~judged.found
    ends = answers.end_us if len(answers.end_us) else np.zeros(1, np.int64)
    row = np.minimum(np.searchsorted(ends, judged.asked_us + late_us), len(ends) - 1)
    there = reference.places.at(judged.asked_us)
    return _stretches(judged.asked_us, missed, ends[row], np.column_stack([there.u_px, there.v_px]))


def false_stretches(judged: ClassifiedRun) -> tuple[ErrorRun, ...]:
    """Runs of false answers."""
    return _stretches(judged.t_us, ~judged.right, judged.end_us, judged.places_px)


def _stretches(
    t_us: NDArray[np.int64], bad: NDArray[np.bool_], look_us: NDArray[np.int64], places_px: Array
) -> tuple[ErrorRun, ...]:
    """Runs of bad items (N,), without a good one or a long gap between."""
    rows = np.flatnonzero(bad)
    if not len(rows):
        return ()
    breaks = (np.diff(rows) > 1) | (np.diff(t_us[rows]) > SPAN_GAP_US)
    groups = np.split(rows, np.flatnonzero(breaks) + 1)
    stretches = []
    for group in groups:
        first, last = group[0], group[-1]
        u_px, v_px = places_px[first].tolist()
        stretches.append(ErrorRun(int(t_us[first]), int(t_us[last]), len(group), int(look_us[first]), (u_px, v_px)))
    return tuple(stretches)


def _by_bin(of: Callable[[Array], np.floating], t_us: NDArray[np.int64], values: Array, edges: NDArray) -> Array:
    place = np.searchsorted(edges, t_us, side="right") - 1
    bins = (values[place == number] for number in range(len(edges) - 1))
    return np.array([of(inside) if len(inside) else np.nan for inside in bins], np.float64)


def _within(reference: PixelReference, start_us: int, end_us: int) -> PixelReference:
    """The reference restricted to [start_us, end_us)."""
    asked = reference.asked_us
    inside = asked[(start_us <= asked) & (asked < end_us)]
    return PixelReference(reference.kind, reference.name, reference.places, inside)
