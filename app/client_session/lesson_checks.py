"""The checks of the lessons: what the modes of one browser know, and whether that is what a lesson asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.export.exporter import ExportState
from app.formatting import percent, share_text
from app.modes.export.mode import ExportMode
from app.modes.label.mode import LabelMode
from app.modes.mode import Mode
from app.modes.train.mode import TrainMode
from app.modes.tune.mode import TuneMode, shown_config
from app.modes.tune.verdict_line import ScoredConfig, ShownWindow
from app.shared.samples import DEMO
from app.shared.training_records import number
from app.state.client_state import ClientState, ModeName
from app.views.requests import is_wrong
from core.recordings import PixelTruth
from labels.arrays import LabelArrays

GOOD_RECALL: Final = 0.95
"""The default settings of `auto` reach 0.988 on the demo's left camera, a circularity limit of 0.8 only 0.484."""
AT_BOUNCE_US: Final = 10_000
LABELS: Final = 5
LABEL_ERROR_PX: Final = 1.0
GOOD_RETURNS: Final = 0.9


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LessonFacts:
    """What the modes of one browser know, as far as a lesson asks for it."""

    on_demo: bool = True
    """Whether the demo recording is open."""
    second_camera: bool = False
    """Whether Tune shows another camera than the first."""
    cursor_us: int = 0
    bounces_us: tuple[int, ...] = ()
    window: ShownWindow | None = None
    """The window of the chosen camera that ends at the cursor, if Tune shows it."""
    config: ScoredConfig | None = None
    """What Tune shows."""
    scores: tuple[tuple[ScoredConfig, float], ...] = ()
    """The last scores of the open recording against the truth, newest first, with their recall."""
    compared: int = 0
    """Methods in the last comparison with the truth."""
    misses_us: frozenset[int] = frozenset()
    """Where the buttons of that comparison go."""
    label_errors_px: tuple[float, ...] = ()
    """Distance from the truth of each ball labelled in the shown layer; infinite where there is none."""
    labels_saved: bool = False
    returned: float | None = None
    """Share returned at the last evaluation of the run that Train shows, 0..1."""
    export: ExportState | None = None
    """The latest export, if this browser asked for it."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Whether a lesson's goal is reached, and how far it is, in one line."""

    done: bool
    so_far: str


def check_find(facts: LessonFacts) -> CheckResult:
    """A ball found in the second camera, at a bounce."""
    if not facts.second_camera:
        return CheckResult(False, "this is the first camera")
    if all(abs(t_us - facts.cursor_us) > AT_BOUNCE_US for t_us in facts.bounces_us):
        return CheckResult(False, "the cursor is at no bounce")
    if facts.window is None or facts.window.miss_px is None:
        return CheckResult(False, "no ball in this window")
    return CheckResult(not is_wrong(facts.window.miss_px), f"a ball, {facts.window.miss_px:.2f} px off the true one")


def check_tune(facts: LessonFacts) -> CheckResult:
    """Recall above `GOOD_RECALL` with the shown config, and below it with another of its method."""
    here, recall = facts.config, dict(reversed(facts.scores))
    if here is None or not recall:
        return CheckResult(False, "no score yet")
    lowest = min((recall[one] for one in recall if (one.camera, one.method) == (here.camera, here.method)), default=1.0)
    if lowest >= GOOD_RECALL:
        return CheckResult(False, f"no score of {here.method} below {GOOD_RECALL:g} yet")
    if here not in recall:
        return CheckResult(False, f"these settings have no score; the lowest is {share_text(lowest)}")
    return CheckResult(recall[here] > GOOD_RECALL, f"recall {share_text(recall[here])}")


def check_compare(facts: LessonFacts) -> CheckResult:
    """Two methods or more compared with the truth, and the cursor at a ball that one of them missed."""
    if facts.compared < 2:
        return CheckResult(False, "no comparison of two methods yet")
    there = facts.cursor_us in facts.misses_us
    return CheckResult(
        there, "a missed ball is shown" if there else f"{facts.compared} methods compared, no miss shown"
    )


def check_label(facts: LessonFacts) -> CheckResult:
    """`LABELS` labelled balls on the disk whose median distance from the truth is at most `LABEL_ERROR_PX`."""
    errors_px = facts.label_errors_px
    if not errors_px:
        return CheckResult(False, "no ball labelled yet")
    median_px = float(np.median(errors_px))
    enough = len(errors_px) >= LABELS and facts.labels_saved
    return CheckResult(
        enough and median_px <= LABEL_ERROR_PX, f"{len(errors_px)} of {LABELS} balls, {median_px:.2f} px off (median)"
    )


def check_train(facts: LessonFacts) -> CheckResult:
    """An evaluation in which the policy returned `GOOD_RETURNS` of the balls or more."""
    if facts.returned is None or math.isnan(facts.returned):
        return CheckResult(False, "no evaluated policy yet")
    return CheckResult(facts.returned >= GOOD_RETURNS, f"{percent(facts.returned)} of the balls returned")


def check_export(facts: LessonFacts) -> CheckResult:
    """A file made of the demo by this browser."""
    export = facts.export
    if export is None or not export.name.startswith(f"{DEMO}-"):
        return CheckResult(False, "no file of the demo yet")
    made = not export.running and not export.failed and export.message.startswith(export.name)
    return CheckResult(made, "the file is being written" if export.running else export.message)


def gather_facts(
    state: ClientState, now_us: int, moments: Mapping[str, NDArray[np.int64]], modes: Mapping[ModeName, Mode]
) -> LessonFacts:
    """What the modes know now: nothing is computed but the distances of a few labels from the truth.

    Args:
        state: of the browser.
        now_us: the time cursor.
        moments: kind -> times, as the time bar marks them.
        modes: of the browser, whether or not they are shown.
    """
    tune, label, train, export = modes["Tune"], modes["Label"], modes["Train"], modes["Export"]
    assert isinstance(tune, TuneMode) and isinstance(label, LabelMode)
    assert isinstance(train, TrainMode) and isinstance(export, ExportMode)
    window, comparison, details, labelling = tune.window, tune.comparison, train.details, label.labelling
    against_truth = comparison is not None and comparison.kind == "truth"
    compared = comparison.methods if comparison is not None and against_truth else ()
    stream = None if labelling is None else labelling.source.stream
    last = details.evaluations[-1] if details is not None and details.evaluations else None
    return LessonFacts(
        on_demo=state.recording == DEMO,
        second_camera=state.camera != state.cameras[0],
        cursor_us=now_us,
        bounces_us=tuple(moments["bounce"].tolist()) if "bounce" in moments else (),
        window=window if window is not None and (window.camera, window.t_us) == (state.camera, now_us) else None,
        config=shown_config(state),
        scores=tune.scores,
        compared=len(compared),
        misses_us=frozenset(miss.look_us for one in compared for miss in one.missed),
        label_errors_px=()
        if labelling is None or stream is None or stream.truth is None
        else label_errors_px(labelling.here.arrays, stream.truth),
        labels_saved=label.is_saved,
        returned=None if last is None else number(last.get("returned")),
        export=export.latest,
    )


def label_errors_px(labels: LabelArrays, truth: PixelTruth) -> tuple[float, ...]:
    """Distance of each labelled ball from the true one, px; infinite where the truth has none."""
    seen = labels.rows(labels.seen)
    there = truth.at(seen.t_us)
    errors_px = np.hypot(seen.x_px - there.u_px, seen.y_px - there.v_px)
    return tuple(np.where(np.isnan(errors_px), np.inf, errors_px).tolist())
