"""A set of recordings of one's own: what there is, who labelled what, and how those labels came about.

Figures of a method from its answers to labels, and between what they lie.

Labels of one ball are alike: what befalls one befalls its neighbours. Intervals therefore count balls, not labels.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import CommandError
from core.metrics import WindowAnswers
from core.metrics.score import MATCH_RADIUS_PX, binomial_interval
from core.recordings import open_recording
from labels.arrays import SOURCES, STATES, LabelArrays
from labels.model import LabelState, PositionSource
from labels.score import GROUPS, pooled, score_groups
from labels.store import LabelStore, Layer, find_layers


@dataclass(frozen=True, slots=True, eq=False)
class LabelledLayer:
    """What one annotator said of one camera of one recording."""

    path: Path
    camera: str
    annotator: str
    blind: bool
    """Second looks, made without seeing the first."""
    labels: LabelArrays
    independent: LabelArrays
    """As they were before conflicts were settled."""
    proposed_by: Mapping[str, int]
    """How many labels are accepted proposals, by the detector that made them."""

    @property
    def asked(self) -> LabelArrays:
        """Labels that a detector is asked about: all but occluded balls."""
        return self.labels.rows(self.labels.state != STATES.index(LabelState.OCCLUDED))


@dataclass(frozen=True, slots=True)
class RecordingCard:
    """One recording of the set, as its file says."""

    recording: str
    uuid: str
    seconds: float
    cameras: tuple[str, ...]
    """Name, width and height in pixels, and whether it is calibrated."""
    events: int
    notes: tuple[str, ...]
    labels: int
    """Of all annotators, without second looks."""


@dataclass(frozen=True, slots=True, eq=False)
class OwnSet:
    """All of it."""

    recordings: tuple[RecordingCard, ...]
    layers: tuple[LabelledLayer, ...]
    """By recording, camera and annotator, second looks last; none without labels."""

    @property
    def annotators(self) -> tuple[str, ...]:
        """Who labelled, by name."""
        return tuple(sorted({layer.annotator for layer in self.first_looks()}))

    def first_looks(self, annotator: str | None = None) -> list[LabelledLayer]:
        """The layers that a detector is scored against, of one annotator if there is a name."""
        return [one for one in self.layers if not one.blind and annotator in (None, one.annotator)]


def own_recordings(place: str) -> tuple[Path, ...]:
    """The file, or the recordings of the folder: those whose names end in `.h5`.

    Raises:
        CommandError: if there is no such place, or nothing in it.
    """
    path = Path(place)
    found = tuple(sorted(path.glob("*.h5"))) if path.is_dir() else (path,) if path.is_file() else ()
    if not found:
        raise CommandError("no recordings", expected="a recording, or a folder of .h5 files", where=place)
    return found


def read_own_set(paths: Sequence[Path], folder: Path, annotator: str | None = None) -> OwnSet:
    """The recordings and the labels of them in a folder of labels, of one annotator if there is a name.

    Raises:
        CommandError: if a recording is there twice, or there are no labels, or none by that annotator.
        RecordingError: if a recording cannot be read.
        LabelError: if a store cannot be read.
    """
    cards: list[RecordingCard] = []
    layers: list[LabelledLayer] = []
    names: set[str] = set()
    of_uuid: dict[str, Path] = {}
    for path in paths:
        with open_recording(path) as recording:
            if recording.uuid in of_uuid:
                same = f"{of_uuid[recording.uuid].name} and {path.name}"
                raise CommandError("the same recording twice", got=same, remedy="take one of them away")
            of_uuid[recording.uuid] = path
            found = [layer for layer in find_layers(folder, recording.uuid) if layer.camera in recording.cameras]
            read = [one for one in (_read_layer(path, folder, layer) for layer in found) if len(one.labels)]
            names |= {layer.annotator for layer in read}
            mine = [one for one in read if annotator in (None, one.annotator)]
            layers += sorted(mine, key=lambda one: one.blind)
            cameras = [
                f"{name} {stream.sensor.width_px}x{stream.sensor.height_px}"
                f"{'' if stream.calibration is None else ', calibrated'}"
                for name, stream in recording.cameras.items()
            ]
            events = sum(stream.event_count for stream in recording.cameras.values())
            counted = sum(len(one.labels) for one in mine if not one.blind)
            seconds = 1e-6 * recording.duration_us
            card = RecordingCard(
                path.name, recording.uuid, seconds, tuple(cameras), events, tuple(recording.notes), counted
            )
            cards.append(card)
    own = OwnSet(tuple(cards), tuple(layers))
    if annotator is not None and names and annotator not in names:
        expected = f"one of {', '.join(sorted(names))}"
        raise CommandError(f"no labels by {annotator!r}", expected=expected, where="--annotator")
    if not own.first_looks():
        remedy = "label some in the app, or name the workspace with --data"
        raise CommandError("no labels of these recordings", got=f"{len(cards)} recordings", where=folder, remedy=remedy)
    return own


def _read_layer(path: Path, folder: Path, layer: Layer) -> LabelledLayer:
    store = LabelStore.read(folder, layer)
    accepted = [one for one in store.all() if one.provenance.source is PositionSource.ACCEPTED]
    by = Counter(one.provenance.detector or "a detector that is not named" for one in accepted)
    return LabelledLayer(
        path, layer.camera, layer.annotator, layer.blind, store.labels(), store.independent().labels, by
    )


def count_by_source(layers: Iterable[LabelledLayer]) -> dict[str, int]:
    """How many labels came about in which way, in the words of `labels.score.GROUPS`; only those that there are."""
    columns = [layer.labels.source.tolist() for layer in layers]
    sources = Counter(tuple(PositionSource)[source] for column in columns for source in column)
    counts = {name: sum(sources[one] for one in group) for name, group in GROUPS.items() if name != "all"}
    return {name: count for name, count in counts.items() if count}


def count_by_state(layers: Iterable[LabelledLayer]) -> dict[str, int]:
    """How many labels say what; only those that there are."""
    states = Counter(STATES[state].value for layer in layers for state in layer.labels.state.tolist())
    return {state.value: states[state.value] for state in STATES if states[state.value]}


Array = NDArray[np.float64]
BALL_GAP_US: Final = 100_000
"""So long without a label of any camera, and the next one is of another ball."""
FEWEST_BALLS: Final = 3
"""For an interval of the errors."""
RESAMPLES: Final = 1000


@dataclass(frozen=True, slots=True, eq=False)
class AnsweredLayer:
    """What a method said at the labels of one layer."""

    answers: WindowAnswers
    labels: LabelArrays
    """Those asked about, a row for each answer."""
    ball: NDArray[np.int64]
    """The number of the ball of each label, the same in all cameras of a recording."""
    cpu_ms: Array
    """Processor time of the steps that answered, those before the labels among them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnBallsRow:
    """A method against labels of one kind, by one annotator. Errors are of answers within 8 px; nan of nothing."""

    method: str
    annotator: str
    group: str
    """Which labels, as in `labels.score.GROUPS`."""
    labels: int
    balls: int
    """That these labels are of."""
    precision: float
    """Share of the answers at labels that are the ball."""
    precision_low: float
    precision_high: float
    recall: float
    """Share of the labels with a ball that have an answer."""
    recall_low: float
    recall_high: float
    error_mean_px: float
    error_median_px: float
    error_median_low_px: float
    error_median_high_px: float
    error_p95_px: float
    error_p95_low_px: float
    error_p95_high_px: float
    along_px: float
    """Mean error along the ball's motion: the delay times the speed."""
    cpu_p50_ms: float
    cpu_p99_ms: float


def ball_numbers(times_us: Sequence[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """For the label times of each camera, ascending, the number of the ball: it begins anew after `BALL_GAP_US`."""
    together = np.unique(np.concatenate([*times_us, np.empty(0, np.int64)]))
    number = np.concatenate([[0], np.cumsum(np.diff(together) > BALL_GAP_US)])
    return [number[np.searchsorted(together, times)] for times in times_us]


def rows_of(method: str, annotator: str, layers: Sequence[AnsweredLayer], *, kinds: bool = True) -> list[OwnBallsRow]:
    """All labels first, then those of each kind that there are, unless only all of them are asked for."""
    asked = [layer for layer in layers if len(layer.labels)]
    if not asked:
        return []
    answers, labels = pooled([(layer.answers, layer.labels) for layer in asked])
    ball = np.concatenate([layer.ball for layer in asked])
    error_px = np.hypot(answers.u_px - labels.x_px, answers.v_px - labels.y_px)
    right = labels.seen & (np.nan_to_num(error_px, nan=np.inf) <= MATCH_RADIUS_PX)
    cpu_ms = np.concatenate([layer.cpu_ms for layer in asked])
    p50_ms, p99_ms = (np.percentile(cpu_ms, (50, 99)) if len(cpu_ms) else np.full(2, np.nan)).tolist()
    rows = []
    for score in score_groups(answers, labels)[: None if kinds else 1]:
        mine = np.isin(labels.source, [SOURCES.index(source) for source in GROUPS[score.group]])
        at = score.at[-1]  # MATCH_RADIUS_PX, as of the simulated recordings
        precision_low, precision_high = _share_interval(at.precision, ball[mine & answers.detected])
        recall_low, recall_high = _share_interval(at.recall, ball[mine & labels.seen])
        (median_low, median_high), (p95_low, p95_high) = error_intervals(error_px[mine & right], ball[mine & right])
        rows.append(
            OwnBallsRow(
                method=method,
                annotator=annotator,
                group=score.group,
                labels=score.labels,
                balls=len(np.unique(ball[mine])),
                precision=at.precision,
                precision_low=precision_low,
                precision_high=precision_high,
                recall=at.recall,
                recall_low=recall_low,
                recall_high=recall_high,
                error_mean_px=score.mean_px,
                error_median_px=score.median_px,
                error_median_low_px=median_low,
                error_median_high_px=median_high,
                error_p95_px=score.p95_px,
                error_p95_low_px=p95_low,
                error_p95_high_px=p95_high,
                along_px=score.along_px,
                cpu_p50_ms=p50_ms,
                cpu_p99_ms=p99_ms,
            )
        )
    return rows


def _share_interval(share: float, ball: NDArray[np.int64]) -> tuple[float, float]:
    """Wilson's, as if each ball had been asked about once."""
    return (math.nan, math.nan) if math.isnan(share) else binomial_interval(share, len(np.unique(ball)))


def error_intervals(error_px: Array, ball: NDArray[np.int64]) -> tuple[tuple[float, float], tuple[float, float]]:
    """95 % bootstrap intervals of the median and of the 95th percentile (px): whole balls are drawn with replacement.

    nan of fewer than `FEWEST_BALLS`.
    """
    numbers = np.unique(ball)
    if len(numbers) < FEWEST_BALLS:
        return (math.nan, math.nan), (math.nan, math.nan)
    of_ball = [error_px[ball == number] for number in numbers]
    rng = np.random.default_rng(0)
    drawn = np.array([
        np.percentile(np.concatenate([of_ball[one] for one in rng.integers(0, len(of_ball), len(of_ball))]), (50, 95))
        for _ in range(RESAMPLES)
    ])  # fmt: skip
    (median_low, p95_low), (median_high, p95_high) = np.percentile(drawn, (2.5, 97.5), axis=0).tolist()
    return (median_low, median_high), (p95_low, p95_high)
