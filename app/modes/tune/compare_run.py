"""One comparison of methods: request, run and result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app import theme
from app.formatting import html_text, share_text, table_row, with_dashes_explained
from app.modes.tune.label_score import labels_to_score
from app.pictures.palette import METHOD_RGB
from app.state.client_state import Slot
from app.state.config_words import settings_words
from core.detection import DetectorConfig
from core.detection.methods import Method
from core.detection.window import WHOLE, EarlyEnds
from core.errors import CommandError
from core.metrics.compare import (
    ClassifiedRun,
    CurvesOverTime,
    ErrorRun,
    PixelReference,
    ReferenceKind,
    bin_edges,
    compare_methods,
    curves_over_time,
    false_stretches,
    labels_reference,
    missed_stretches,
    truth_reference,
)
from core.metrics.run import LEAD_IN_US, duration_of
from core.recordings import CameraStream, PixelTruth
from core.recordings.recording import freeze_camera
from core.text import counted
from labels.arrays import STATES
from labels.model import LabelState

FALLBACK: Final[Method] = "refined"
"""Reference method where there is neither truth nor labels."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CompareRequest:
    """A request for a comparison, with everything it needs."""

    recording: str
    uuid: str
    stream: CameraStream
    configs: tuple[tuple[Method, DetectorConfig], ...]
    slot: Slot
    """The slot that the configs are of."""
    agree_with: Method | None
    """Reference method; None: the camera's truth or labels."""
    labels: Path
    """The folder of the label stores."""
    start_us: int
    end_us: int
    live: bool
    """Whether the camera is live; its events are then copied first, so that every method sees the same ones."""
    added_us: float = 0.0
    """What an answer takes besides computing, for the score in time."""
    ends: EarlyEnds = WHOLE
    """What ends windows early; not against labels."""


@dataclass(frozen=True, slots=True, eq=False)
class ComparedMethod:
    """Result of one method."""

    judged: ClassifiedRun
    config: str
    """Slot and settings, in words."""
    curves: CurvesOverTime
    missed: tuple[ErrorRun, ...]
    false: tuple[ErrorRun, ...]

    @property
    def method(self) -> Method:
        """Name of the method."""
        return self.judged.run.method


@dataclass(frozen=True, slots=True, eq=False)
class CompareAnswer:
    """Result of a comparison."""

    title: str
    camera: str
    kind: ReferenceKind
    reference: str
    """Name of the reference."""
    nothing_known: bool
    """Whether truth or labels were requested but there are none."""
    axis_s: NDArray[np.float64]
    """(B,) middles of the bins of the curves."""
    methods: tuple[ComparedMethod, ...]


def known_reference(labels: Path, uuid: str, stream: CameraStream) -> PixelReference | None:
    """The truth of a camera, else the labels of whoever made the most; None where nothing is known."""
    if stream.truth is not None:
        return truth_reference(stream.truth, stream.sensor)
    store = labels_to_score(labels, uuid, stream)
    if store is None:
        return None
    kept = store.labels()
    kept = kept.rows(kept.state != STATES.index(LabelState.OCCLUDED))
    places = PixelTruth(kept.t_us, kept.x_px, kept.y_px, kept.r_px, kept.seen)
    return labels_reference(places, f"{counted(len(kept), 'label')} by {store.layer.annotator}")


class KnownReferences:
    """Reference positions of the ball in each camera; labels are cached until they may have changed. Thread-safe."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str], PixelReference | None] = {}

    def find(self, labels: Path, uuid: str, stream: CameraStream) -> PixelReference | None:
        """Result of `known_reference`; where there is truth, only for the given times."""
        truth = stream.truth
        if truth is not None:  # not kept: that of a live recording grows
            return PixelReference("truth", "the truth", truth, truth.t_us[:0])
        key = (uuid, stream.name)
        if key not in self._kept:
            self._kept[key] = known_reference(labels, uuid, stream)
        return self._kept.get(key)

    def clear(self) -> None:
        """Clear the cache."""
        self._kept = {}


def check_whole(ends: EarlyEnds) -> None:
    """Raises CommandError for windows that end early: each label is asked for a whole one."""
    if ends.words:
        remedy = "set Window ends to 0 in the tab Score"
        raise CommandError("labels are asked for whole windows", got=f"windows that end {ends.words}", remedy=remedy)


def run_comparison(
    request: CompareRequest, *, progress: Callable[[float], None], cancelled: Callable[[], bool]
) -> CompareAnswer:
    """Run the methods, and prepare what is shown; of no use if it was cancelled meanwhile.

    Raises:
        CommandError: if there are no events in the part that is asked for, or windows end early against labels.
    """
    stream = request.stream
    end_us = min(request.end_us, duration_of(stream))
    if end_us <= request.start_us:
        raise CommandError("no events in this part of the recording", remedy="move the cursor, or compare all of it")
    if request.live:
        # The ring forgets: a run takes longer than what it remembers.
        stream = freeze_camera(stream, request.start_us - LEAD_IN_US, end_us)
    against: PixelReference | Method | None = request.agree_with
    if against is None:
        against = known_reference(request.labels, request.uuid, stream)
    if isinstance(against, PixelReference) and against.kind == "labels":
        check_whole(request.ends)
    outcome = compare_methods(
        stream,
        dict(request.configs),
        against or FALLBACK,
        request.start_us,
        end_us,
        added_us=request.added_us,
        ends=request.ends,
        progress=progress,
        cancelled=cancelled,
    )
    edges = bin_edges(outcome.start_us, outcome.end_us)
    methods = tuple(
        ComparedMethod(
            judged,
            f"{request.slot}: {settings_words(judged.run.method, dict(request.configs)[judged.run.method])}",
            curves_over_time(judged, edges),
            missed_stretches(judged, outcome.reference),
            false_stretches(judged),
        )
        for judged in outcome.judged
    )
    early = f", windows end {request.ends.words}" if request.ends.words else ""
    return CompareAnswer(
        title=f"{request.recording}, {stream.name}, {request.start_us / 1e6:.2f} to {end_us / 1e6:.2f} s{early}",
        camera=stream.name,
        kind=outcome.reference.kind,
        reference=outcome.reference.name,
        nothing_known=against is None,
        axis_s=(edges[:-1] + edges[1:]) / 2e6,
        methods=methods,
    )


MAX_STRETCHES: Final = 40
"""Most intervals that get a button; the longest ones are taken."""
CELL: Final = "padding:0 5px 0 0;white-space:nowrap"


def comparison_html(answer: CompareAnswer) -> str:
    """HTML with a row for each method, and the reference."""
    agreement = answer.kind == "method"
    name = html_text(answer.reference)
    titles = ("", "shared" if agreement else "recall", "precision", "px p50 / p95", "ms p50 / p99")
    in_time = answer.kind == "truth"
    titles = (*titles, "live px", "age ms") if in_time else titles
    head = table_row(titles, f"text-align:left;font-weight:500;{CELL};white-space:normal", tag="th")
    rows = "".join(_row(one) for one in answer.methods)
    counted = f"against {name}, counted as in Score: a ball counts as found within 8 px"
    if in_time:
        counted += (
            ". One delay of sensor and method is taken out of each. Live: the newest answer that a robot would have, "
            "extrapolated with the ball's velocity, with the extra latency of the tab Score: its median error and age"
        )
    if agreement:
        counted = (
            f"<b>agreement with {name}, not error</b>: shared is how many of its balls a method has too, "
            f"within 8 px, and px how far apart they are"
        )
        if answer.nothing_known:
            counted = f"this camera has neither truth nor labels. {counted}"
    muted = f"color:{theme.MUTED}"
    table = with_dashes_explained(f"<table>{head}{rows}</table>")
    return (
        f"<div style='font-size:12px;padding:4px 8px'>{html_text(answer.title)}"
        f"<div style='overflow-x:auto;font-size:11px'>{table}</div>"
        f"<div style='{muted}'>{counted}. ms: processor time of a window.</div></div>"
    )


def method_css(method: Method) -> str:
    """The colour of a method."""
    red, green, blue = METHOD_RGB[method]
    return f"rgb({red},{green},{blue})"


def stretch_names(stretches: tuple[ErrorRun, ...]) -> dict[str, ErrorRun]:
    """Longest intervals by the (unique) names of their buttons, in order of time."""
    longest = sorted(stretches, key=lambda one: -one.count)[:MAX_STRETCHES]
    names: dict[str, ErrorRun] = {}
    for one in sorted(longest, key=lambda one: one.start_us):
        times = f" ×{one.count}" if one.count > 1 else ""
        names[f"{one.start_us / 1e6:.4f} s{times}"] = one
    return names


def stretches_html(answer: CompareAnswer, method: Method, *, missed: bool) -> str:
    """HTML heading of the buttons below."""
    (one,) = (one for one in answer.methods if one.method == method)
    stretches = one.missed if missed else one.false
    count = sum(stretch.count for stretch in stretches)
    asked, answers = len(one.judged.asked_us), len(one.judged.t_us)
    if missed:
        what = f"Missed at {count:,} of {counted(asked, 'time')}" if count else f"No misses at {counted(asked, 'time')}"
    else:
        what = f"{count or 'None'} of {answers} answers are wrong"
    if answer.kind == "method":
        what += f", if {html_text(answer.reference)} is right"
    more = len(stretches) - MAX_STRETCHES
    rest = f" The {MAX_STRETCHES} longest are listed." if more > 0 else ""
    kind = "gap" if missed else "place"
    where = f"in one {kind}" if len(stretches) == 1 else f"in {len(stretches)} {kind}s"
    places = f", {where}.{rest} Click one to go there" if stretches else ""
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:0 12px'>{what}{places}</div>"


def _row(one: ComparedMethod) -> str:
    judged, in_time = one.judged, one.judged.in_time
    delay = "" if in_time is None else f"; delay taken out: {judged.delay_us} us"
    live = () if in_time is None else (_number(in_time.moved_median_px), _number(1e-3 * in_time.age_median_us))
    cells = (
        f"<span style='color:{method_css(one.method)}'>●</span> {html_text(one.method)}",
        share_text(judged.recall),
        share_text(judged.precision),
        f"{_number(judged.error_at(50))} / {_number(judged.error_at(95))}",
        f"{_number(1e3 * judged.step_at(50))} / {_number(1e3 * judged.step_at(99))}",
        *live,
    )
    # In a row of its own: beside the figures it is a column of single words.
    config = f"<tr><td colspan='{len(cells)}' style='color:{theme.MUTED}'>{html_text(one.config + delay)}</td></tr>"
    return table_row(cells, CELL) + config


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2f}"
