"""The paper's comparisons: what is divided by what, its figure, ours, and whether it holds here."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from benchmarks.perception import words
from benchmarks.perception.plan import BALL_ONLY, RIVALS
from benchmarks.perception.results import PerceptionResult, RecordingReading
from benchmarks.perception.summary import (
    EVENT_BYTES,
    Results,
    SeedRun,
    bytes_per_detection,
    error_mean_px,
    error_px,
    interval,
    latency_p50_ms,
    mean,
    precision,
    ratio,
    recall,
    sensing_ms,
)
from benchmarks.perception.words import one_line

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
        one_line(words.DATA_HOW, event_bytes=EVENT_BYTES),
        "99.8 %",
        one_line(
            words.DATA_OURS,
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
        one_line(words.LATENCY_HOW),
        "96.4 %",
        one_line(words.LATENCY_OURS, all=text, sensed=_percent(sensed)),
        frame_verdict(runs, value, PAPER_LATENCY_SAVED),
    )


def _recall(runs: Sequence[SeedRun], method: str) -> PaperComparison:
    value, text = _over_seeds(runs, lambda run: best_recall_gain(run, method))
    whole = mean([recall_gain(run, method) for run in runs])
    return PaperComparison(
        f"up to 27.5 % more recall than RGB, `{method}`",
        one_line(words.RECALL_HOW),
        "27.5 %",
        one_line(words.RECALL_OURS, best=text, whole=_percent(whole)),
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
