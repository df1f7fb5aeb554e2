"""Figures of a method from its results, how much they depend on the seed, and the paper's comparisons: what is
divided by what, its figure, ours, and whether it holds here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from benchmarks.perception.measure import SENSOR_DELAY_US
from benchmarks.perception.results import BALL_ONLY, RIVALS, PerceptionResult, RecordingReading, median_with_lost

TITLE: Final = "Perception: every method on recordings after the paper's"
PICTURES: Final = "Every method on the same window"

CONDITIONS: Final = """
Made by `rallyscope bench paper-perception --count {count}`: the seven simulated recordings of the preset `paper7`
(1280x720, two cameras; three with the ball only, four with people, the last one a rally of two players), with the
settings of each method as they come. Seeds: {seeds}. {brackets}

The recordings are simulated after the paper's description; its own cannot be had. Equal figures would not mean equal
recordings.

`yolo` looks at the frames of the same recordings, the others at their events. {frame_detector}

More seeds: `--count 10`. A set is made where it is missing (415 seconds of one core's time, 0.5 GB), what was measured
is kept, and the same command goes on where it was ended.

Machine: {machine}.
"""
OVER_SEEDS: Final = """
In brackets the 95 % bootstrap interval of the mean over the seeds; with fewer than about ten it is narrower than it
should be.
"""
OVER_RECORDINGS: Final = """
With fewer than {fewest} seeds there is no interval over seeds: in brackets are the least and the greatest of the
single recordings, which says how much they differ and nothing of how sure the figure is.
"""

FRAME_DETECTOR: Final = """
It is YOLOv4-tiny with the weights that come with the package, trained on rendered pictures with seeds of their own
(docs/how/detector.md). On unseen sharp frames (0.5 ms) its recall is {sharp}; with 0.9 or more it counts as a rival. A
time of the recall's grid is found with a right answer within half a frame's period, of events within half a window, so
that `yolo` is asked no more often than there are frames.
"""
NO_FRAME_DETECTOR: Final = """
It has no weights here, so that its rows are empty and nothing is said of what the paper compares with RGB, except the
data, for which the size of the frames is enough: `rallyscope train-detector yolo` makes some.
"""

COMPARISONS: Final = """
The paper states ratios and not how they are computed; `how` says what is divided here. Where it says "up to", the best
recording counts. The rivals are our implementations, tuned on other simulated flights; how the paper tuned its own,
it does not say.

For the latency: light to answer takes `{method}` {least_ms:.2f} ms (p50), so {saved:.1f} % less would mean a frame
detector that takes {frame_ms:.0f} ms or more. {frames}
"""
NO_FRAMES: Final = "The recordings have no frames."
FRAMES: Final = """
Of a frame, light waits {wait_ms:.1f} ms on average for the end of the exposure ({exposure_ms:.1f} ms), one frame
comes every {period_ms:.1f} ms, the read-out takes {readout_ms:.1f} ms (assumed: that of a sensor of 120 pictures a
second at most), and the detector comes on top. For each frame with a
ball, {megabytes:.2f} MB of frames have to be read.
"""
DATA_HOW: Final = """
1 - bytes of all events ({event_bytes} each) per right answer / bytes of all frames (3 a pixel) per frame with a ball;
the best recording
"""
DATA_OURS: Final = """
{best}; all recordings {whole}; frames of one byte a pixel {mosaic}; per second, whatever is found, {rate}; all frames
per right answer of `yolo`, all recordings {found}
"""
LATENCY_HOW: Final = """
1 - latency from events / latency of `yolo` on frames, both light to answer p50 over all recordings, exposure and
read-out included
"""
LATENCY_OURS: Final = """
{all}; if the network took no time {sensed}
"""
RECALL_HOW: Final = """
recall from events / recall of `yolo` on frames - 1; the best recording
"""
RECALL_OURS: Final = """
{best}; all recordings {whole}
"""

SCENES: Final = """
Ours / the paper's. The paper does not say whether its error is a mean or a median; the verdict takes the mean. It
holds with at least the paper's precision and recall, and at most its error.
"""

LIMITS: Final = """
One read per event: a compiled pass over the events takes {read_ns:.2f} ns for each; no detector that looks at every
event of its window can be faster.

Circle-fit bound: n points all round a circle, each with a radial error of sigma = 1/sqrt(12) = 0.29 px (an event says
that the edge was somewhere in its pixel), leave a variance of at least 2 sigma^2 / n on each axis of the centre
(Cramer-Rao; points on one side only leave more), hence a median distance of at least sqrt(2 ln 2) sigma sqrt(2 / n).
`events` counts as n every event within 1.5 px of the true edge at its time, `pixels` only the different pixels among
them: a pixel's second event says little new. Of one window; for `refined` of the history that it looks back on (3.5
px of motion). `ebpp` keeps a surface of older edges and may use more than its window. The time at which an event came
says more than its pixel alone, so the bound is no law for methods that use it.
"""

DEFINITIONS: Final = """
Delay: sensor and method delay an answer, and each method states its time in its own way. Of each camera and method
one delay, that without which the median error is least, is taken out of all answers before anything is compared. Below,
the time of an answer is what it states less this delay; a point in space has the mean of its cameras.

Precision: every answer without the ball within 8 px at its time is false. Recall: of the whole milliseconds at which
the whole disc is in view and has been for 10 ms, those with a right answer within half a window. Errors are those of
right answers, at their time. Both cameras, balls of any speed.

In time: at times {every_us} us apart, whatever the windows, a robot has the newest answer whose window had ended and
whose step, on this machine, was over by then: held where it was, or moved on by the ball's velocity
(docs/how/score-in-time.md).

3D: distance of the chain's points from the ball at their time. Hitting point: along the plane x = -1.42 m, what the
chain says at its last step 100 ms before the ball is there; the last column is the share of balls with a prediction.
`paper` predicts by the paper's five-point rule and checks no sizes; the others with the filter, with known physics.

Bytes per detection: all events that the detector was given, {event_bytes} bytes each (EVT 2.0), over its right
answers; of `yolo` all frames, 3 bytes a pixel. (In the columns of our files an event has 13 bytes before
compression.)

CPU: processor time of one thread for one step of one camera that answered, warm, events in memory. Light to answer:
the sensor's delay ({delay_ms:.2f} ms) + waiting for the end of the window + the step. p50 takes half a window and the
median step; p99 the whole window, as for light that came first, and the 99th percentile of the steps: at most one
answer in a hundred comes later. Transfer from the camera is not in it. For `yolo`: half the exposure (p50) or all
of it (p99), the read-out ({readout_ms:.1f} ms, assumed) and the step; light between two exposures is not waited for,
since nobody sees it.

Recovery: from a ball's appearance, after at least 5 ms without one and for at least 10 ms, to the end of the first
window with a right answer; balls that are never found count as endless.
"""

PICTURE_WORDS: Final = """
The window lies in the middle of those with the whole ball in the first camera's picture, whatever the methods say of
it. Events of the last 2 ms: ON orange, OFF blue. The dashed black circle is the ball at the time that the answer
states, the green one with a cross the answer; one that is farther away is not in the picture.
"""


def paragraphs(text: str, **values: object) -> tuple[str, ...]:
    """The paragraphs of a text, filled in, a line each."""
    return tuple(" ".join(part.split()) for part in text.format(**values).strip().split("\n\n"))


def one_line(text: str, **values: object) -> str:
    """A text of a single paragraph."""
    return " ".join(paragraphs(text, **values))


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


def delay_us(results: Results) -> float:
    """Mean over the cameras of the delay that was taken out of the answers."""
    delays = [delay for one in results for delay in one.delay_us]
    return ratio(sum(delays), len(delays))


def age_ms(percent: float) -> Callable[[Results], float]:
    """A percentile of the age of the newest answer with a ball, at the times with a ball."""
    return lambda results: percentile((one.age_ms for one in results), percent)


def held_px(percent: float) -> Callable[[Results], float]:
    """A percentile of the distance of the newest answer from the ball."""
    return lambda results: percentile((one.held_px for one in results), percent)


def moved_px(percent: float) -> Callable[[Results], float]:
    """A percentile of that distance if the answer is moved on by the ball's velocity."""
    return lambda results: percentile((one.moved_px for one in results), percent)


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
    "delay_us": delay_us,
    "age_median_ms": age_ms(50),
    "age_p95_ms": age_ms(95),
    "held_median_px": held_px(50),
    "moved_median_px": moved_px(50),
    "moved_p95_px": moved_px(95),
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


PAPER_DATA_SAVED: Final = 0.998
PAPER_LATENCY_SAVED: Final = 0.964
PAPER_RECALL_GAIN: Final = 0.275
PAPER_ACCURACY_GAIN: Final = 0.897
NOT_MEASURED: Final = "not measured: no weights of `yolo`, or no frames"
FRAME_RIVAL: Final = "yolo"
MIN_SHARP_RECALL: Final = 0.9
"""Of sharp pictures; a detector that finds less of them is no rival: training would decide and not blur."""
OURS: Final = ("paper", "refined")
BAYER: Final = 3
"""A sensor behind a colour mosaic sends a byte for each pixel and not three."""


class PaperScene(NamedTuple):
    """A row of the paper's table of scenes with people."""

    precision: float
    recall: float
    error_px: float


PAPER_SCENES: Final[dict[str, PaperScene]] = {
    "real4": PaperScene(1.0, 0.928, 2.61),
    "real5": PaperScene(1.0, 0.985, 2.77),
    "real6": PaperScene(1.0, 0.902, 2.59),
    "real7": PaperScene(1.0, 0.794, 2.89),
}


@dataclass(frozen=True, slots=True)
class PaperComparison:
    """One claim of the paper and what became of it."""

    claim: str
    how: str
    """What is divided by what."""
    paper: str
    ours: str
    verdict: str
    """`holds`, `does not hold`, or why nobody knows."""


def compare(runs: Sequence[SeedRun]) -> list[PaperComparison]:
    """Every claim about perception, in the order of the paper's summary."""
    found = [_data(runs, method) for method in OURS]
    found += [_latency(runs, method) for method in OURS]
    found += [_recall(runs, method) for method in OURS]
    found += [_accuracy(runs, method, rival) for method in OURS for rival in RIVALS]
    return found


def data_saved(results: Sequence[PerceptionResult], readings: Sequence[RecordingReading], mosaic: int = 1) -> float:
    """1 - bytes of events per right answer / bytes of frames per frame with a ball in it; nan without frames."""
    frames = frame_bytes_per_ball(readings) / mosaic
    return 1 - bytes_per_detection(results) / frames if frames > 0 else math.nan


def frame_bytes_per_ball(readings: Sequence[RecordingReading]) -> float:
    """What a frame detector that misses nothing would have read for each answer; nan without frames."""
    return ratio(sum(one.frames * one.frame_bytes for one in readings), sum(one.frames_with_ball for one in readings))


def rate_saved(readings: Sequence[RecordingReading]) -> float:
    """1 - bytes of events a second / bytes of frames a second, whatever is made of them; nan without frames."""
    events = ratio(EVENT_BYTES * sum(one.events for one in readings), sum(one.seconds for one in readings))
    frames = mean([ratio(1e6 * one.frame_bytes, one.frame_period_us) for one in readings])
    return 1 - ratio(events, frames)


def best_data_saved(run: SeedRun, method: str, mosaic: int = 1) -> float:
    """The greatest of the recordings: the paper says "up to"."""
    return _greatest(data_saved(run.of(method, [one.recording]), [one], mosaic) for one in run.readings)


def data_saved_of_found(run: SeedRun, method: str) -> float:
    """1 - bytes of events per right answer / bytes of frames per right answer of the frame detector."""
    return 1 - ratio(bytes_per_detection(run.of(method)), bytes_per_detection(run.of(FRAME_RIVAL)))


def latency_saved(run: SeedRun, method: str, *, sensing: bool = False) -> float:
    """1 - latency from events / latency from frames, medians over all recordings.

    With `sensing` the frame detector's own computing is left out, as if its processor took no time.
    """
    theirs = sensing_ms(run.of(FRAME_RIVAL), 0.5) if sensing else latency_p50_ms(run.of(FRAME_RIVAL))
    return 1 - ratio(latency_p50_ms(run.of(method)), theirs)


def recall_gain(run: SeedRun, method: str, recordings: Sequence[str] | None = None) -> float:
    """Recall from events / recall from frames - 1."""
    return ratio(recall(run.of(method, recordings)), recall(run.of(FRAME_RIVAL, recordings))) - 1


def best_recall_gain(run: SeedRun, method: str) -> float:
    """The greatest of the recordings: the paper says "up to"."""
    return _greatest(recall_gain(run, method, [one.recording]) for one in run.readings)


def frame_verdict(runs: Sequence[SeedRun], ours: float, paper: float) -> str:
    """As `verdict`, if the frame detector was measured and is a rival."""
    measured = [one for run in runs for one in run.of(FRAME_RIVAL)]
    if not measured:
        return NOT_MEASURED
    sharp = min(one.sharp_recall or 0.0 for one in measured)
    if sharp < MIN_SHARP_RECALL:
        return f"no verdict: recall {sharp:.2f} of sharp frames is no rival's"
    return verdict(ours, paper)  # "not measured" where it, or the method, found nothing at all


def best_accuracy_gain(
    run: SeedRun, method: str, rival: str, error: Callable[[Results], float] = error_mean_px
) -> float:
    """1 - our error / theirs, negative where ours is the larger: the greatest of the recordings with the ball only."""
    names = [one.recording for one in run.readings if one.scene == BALL_ONLY]
    return _greatest(1 - ratio(error(run.of(method, [name])), error(run.of(rival, [name]))) for name in names)


def verdict(ours: float, paper: float, *, digits: int = 3) -> str:
    """Whether ours is at least the paper's figure, both with as many digits as the paper gives."""
    if math.isnan(ours):
        return "not measured"
    return "holds" if round(ours, digits) >= round(paper, digits) else "does not hold"


def scene_verdict(results: Sequence[PerceptionResult], paper: PaperScene) -> str:
    """Which of the three figures of a scene are reached."""
    ours = precision(results), recall(results), error_mean_px(results)
    if any(map(math.isnan, ours)):
        return "not measured"
    reached = {
        "precision": round(ours[0], 3) >= paper.precision,
        "recall": round(ours[1], 3) >= paper.recall,
        "error": round(ours[2], 2) <= paper.error_px,
    }
    if all(reached.values()):
        return "holds"
    missed = ", ".join(name for name, met in reached.items() if not met)
    return f"does not hold: {missed}"


def _data(runs: Sequence[SeedRun], method: str) -> PaperComparison:
    value, text = _over_seeds(runs, lambda run: best_data_saved(run, method))
    whole = mean([data_saved(run.of(method), run.readings) for run in runs])
    mosaic = mean([best_data_saved(run, method, BAYER) for run in runs])
    rate = mean([rate_saved(run.readings) for run in runs])
    found = mean([data_saved_of_found(run, method) for run in runs])
    return PaperComparison(
        f"up to 99.8 % less data than RGB, `{method}`",
        one_line(DATA_HOW, event_bytes=EVENT_BYTES),
        "99.8 %",
        one_line(
            DATA_OURS,
            best=text,
            whole=_percent(whole),
            mosaic=_percent(mosaic),
            found=_percent(found),
            rate=_percent(rate),
        ),
        verdict(value, PAPER_DATA_SAVED),
    )


def _latency(runs: Sequence[SeedRun], method: str) -> PaperComparison:
    value, text = _over_seeds(runs, lambda run: latency_saved(run, method))
    sensed = mean([latency_saved(run, method, sensing=True) for run in runs])
    return PaperComparison(
        f"up to 96.4 % less latency than RGB, `{method}`",
        one_line(LATENCY_HOW),
        "96.4 %",
        one_line(LATENCY_OURS, all=text, sensed=_percent(sensed)),
        frame_verdict(runs, value, PAPER_LATENCY_SAVED),
    )


def _recall(runs: Sequence[SeedRun], method: str) -> PaperComparison:
    value, text = _over_seeds(runs, lambda run: best_recall_gain(run, method))
    whole = mean([recall_gain(run, method) for run in runs])
    return PaperComparison(
        f"up to 27.5 % more recall than RGB, `{method}`",
        one_line(RECALL_HOW),
        "27.5 %",
        one_line(RECALL_OURS, best=text, whole=_percent(whole)),
        frame_verdict(runs, value, PAPER_RECALL_GAIN),
    )


def _accuracy(runs: Sequence[SeedRun], method: str, rival: str) -> PaperComparison:
    value, text = _over_seeds(runs, lambda run: best_accuracy_gain(run, method, rival))
    median = mean([best_accuracy_gain(run, method, rival, error_px(50)) for run in runs])
    return PaperComparison(
        f"up to 89.7 % more accurate than event rivals, ball only: `{method}` and `{rival}`",
        "1 - our mean error / theirs, right answers only; the best of real1 to real3",
        "89.7 %",
        f"{text}; of the median errors {_percent(median)}",
        verdict(value, PAPER_ACCURACY_GAIN),
    )


def _over_seeds(runs: Sequence[SeedRun], of: Callable[[SeedRun], float]) -> tuple[float, str]:
    values = [of(run) for run in runs]
    low, high = interval(values, values)
    text = _percent(mean(values))
    return mean(values), text if low == high or math.isnan(low) else f"{text} [{100 * low:.1f}, {100 * high:.1f}]"


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.1f} %"


def _greatest(values: Iterable[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return max(known, default=math.nan)
