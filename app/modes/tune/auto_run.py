"""Automatic tuning: runs `rallyscope tune` as a child process, reads its report, and makes the table that Tune
shows.
"""

from __future__ import annotations

import math
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from app import theme
from app.background.child import ChildProcess, share_in
from app.formatting import html_text, share_text, table_row, with_dashes_explained
from app.modes.tune.label_score import find_reference
from app.modes.tune.settings import stage_counts_html
from app.state.config_words import value_text
from core.detection import DetectorConfig
from core.detection.methods import Method
from core.detection.saved import load_detector, save_detector
from core.detection.window import WHOLE, EarlyEnds
from core.errors import CommandError, RallyscopeError
from core.text import counted, parse_json
from core.tuning.objective import Figures, measurably_differ
from labels.tuning_objective import Against

TITLES: Final = ("windows", "config", "precision", "recall", "median error", "objective")
CELL: Final = "padding-right:14px;white-space:nowrap"
BAR_PX: Final = 60
IMPORTANCE: Final = "Importance: how much of the difference between trials a threshold explains, changed in B or not."


@dataclass(frozen=True, slots=True)
class SidesFigures:
    """Figures of one config on the training and the held-out side of the split."""

    tuned: Figures
    held_out: Figures


@dataclass(frozen=True, slots=True)
class TuningReport:
    """Result of a search for thresholds."""

    start: SidesFigures
    best: SidesFigures
    best_trial: int
    """Number of the best trial; 0 if none was better than the start config."""
    trials: int
    better_held_out: bool
    changed: Mapping[str, tuple[object, object]]
    """Value before and after, by the threshold's name."""
    importance: Mapping[str, float]
    """Importance of each threshold as a share, largest first; empty if unknown."""


def read_report(line: str) -> TuningReport:
    """Parse the JSON line that `rallyscope tune` prints.

    Raises:
        ValueError: if it is none.
    """
    values = parse_json(line)
    if not isinstance(values, dict) or "importance" not in values:
        raise ValueError(f"not a report: {line[:80]}")
    return TuningReport(
        start=_sides(values["start"]),
        best=_sides(values["best"]),
        best_trial=values["best_trial"],
        trials=values["trials"],
        better_held_out=values["better_held_out"],
        changed={name: (before, after) for name, (before, after) in values["changed"].items()},
        importance=values["importance"],
    )


def report_html(title: str, report: TuningReport) -> str:
    """HTML of the report: figures on both sides of the split, and the changed thresholds."""
    start, best = report.start, report.best
    rows = [
        _row("tuned on", "A", start.tuned),
        _row("", "B", best.tuned),
        _row("held out", "A", start.held_out),
        _row("", "B", best.held_out),
    ]
    sides = with_dashes_explained(f"<table>{_head(TITLES)}{''.join(rows)}</table>")
    thresholds = f"<table>{_head(('threshold', 'A', 'B', 'importance'))}{_thresholds(report)}</table>"
    if report.importance:
        thresholds = f"<div>{thresholds}<div style='color:{theme.MUTED}'>{IMPORTANCE}</div></div>"
    head = f"Result of {html_text(title)}, {counted(report.trials, 'trial')}. {_verdict(report)}"
    return (
        f"<div style='font-size:12.5px;padding:4px 12px'>{head}"
        f"<div style='display:flex;gap:24px;align-items:flex-start'><div>{sides}</div>{thresholds}</div></div>"
    )


def running_html(title: str, state: str = "") -> str:
    """HTML in place of a result while a search runs; `state` says how far it is."""
    return stage_counts_html(f"Auto-tune runs: {html_text(title)}: {html_text(state or 'reading the recording')}")


def _sides(values: Mapping[str, Mapping[str, Any]]) -> SidesFigures:
    return SidesFigures(_figures(values["tuned"]), _figures(values["held_out"]))


def _figures(values: Mapping[str, Any]) -> Figures:
    ratios = {name: math.nan if value is None else float(value) for name, value in values.items() if name != "balls"}
    return Figures(**ratios, balls=int(values["balls"]))


def _verdict(report: TuningReport) -> str:
    before, after = report.start.held_out, report.best.held_out
    figures = f"on the held-out windows ({before.objective:.4f} before, {after.objective:.4f} now)"
    if report.best_trial == 0:
        return f"<span style='color:{theme.MUTED}'>No better config was found: B equals A.</span>"
    if not measurably_differ(before, after):
        return f"<span style='color:{theme.MUTED}'>No measurable difference {figures}.</span>"
    if report.better_held_out:
        return f"<span style='color:{theme.GOOD}'>B is also better {figures}.</span>"
    return f"<span style='color:{theme.BAD}'>B is not better {figures}: it is overfitted.</span>"


def _thresholds(report: TuningReport) -> str:
    names = sorted(report.importance or report.changed, key=lambda name: name not in report.changed)  # a stable sort
    rows = []
    for name in names:
        before, after = report.changed.get(name, ("", "as it was"))
        share = report.importance.get(name)
        bar = "" if share is None else f"{_bar(share)} {100 * share:.0f} %"
        rows.append(
            table_row((html_text(name), html_text(value_text(before)), html_text(value_text(after)), bar), CELL)
        )
    return "".join(rows)


def _bar(share: float) -> str:
    width = max(1, round(BAR_PX * share))
    return f"<span style='display:inline-block;height:8px;width:{width}px;background:rgb{theme.BRAND_RGB}'></span>"


def _row(side: str, config: str, figures: Figures) -> str:
    found = "-" if math.isnan(figures.median_error_px) else f"{figures.median_error_px:.2f} px"
    return table_row(
        (side, config, share_text(figures.precision), share_text(figures.recall), found, f"{figures.objective:.4f}"),
        CELL,
    )


def _head(titles: tuple[str, ...]) -> str:
    return table_row(titles, f"text-align:left;font-weight:500;{CELL}", tag="th")


LOOK_S: Final = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class AutoTuneRequest:
    """A request for automatic tuning, with everything it needs."""

    title: str
    """Title of what is tuned on, as shown."""
    recording: Path
    uuid: str
    camera: str
    all_cameras: bool
    method: Method
    against: Against
    labels: Path
    """The folder of the label stores."""
    parameters: tuple[str, ...]
    trials: int
    seed: int
    start: DetectorConfig
    added_us: int | None = None
    """Score in time, with this extra latency; None: each answer at its own time."""
    ends: EarlyEnds = WHOLE
    """What ends windows early; not against labels."""
    where: tuple[str, ...]
    """The flags of `tune` that say where the trials are made."""


@dataclass(frozen=True, slots=True)
class AutoTuneAnswer:
    """Answer to an `AutoTuneRequest`."""

    config: DetectorConfig
    report: TuningReport


class AutoTuneCancelledError(Exception):
    """The search was cancelled."""


def run_auto_tune(
    request: AutoTuneRequest,
    *,
    progress: Callable[[float], None],
    say: Callable[[str], None],
    cancelled: Callable[[], bool],
) -> AutoTuneAnswer:
    """Run the search and wait for its result; `say` gets progress messages.

    Raises:
        RallyscopeError: with what the verb said if it refuses or fails.
        AutoTuneCancelledError: when `cancelled()` becomes true; the process is over then.
    """
    with tempfile.TemporaryDirectory(prefix="rallyscope-tune-") as folder:
        start, found = Path(folder) / "start.toml", Path(folder) / "found.toml"
        save_detector(request.method, request.start, start)
        answer = ""
        ended = threading.Event()

        def hear(line: str) -> None:
            nonlocal answer
            # The verb prints its answer as one line of JSON, and its progress as text.
            if line.startswith("{"):
                answer = line
            elif (share := share_in(line)) is not None:
                progress(share)
                say(line)

        child = ChildProcess(*tune_command(request, start, found), on_line=hear, on_end=ended.set)
        while not ended.wait(LOOK_S):
            if cancelled():
                child.stop()
                raise AutoTuneCancelledError
        code = child.wait()
        # Bad input by the contract of the command line, with a line that is meant for people.
        if code == 2:
            raise RallyscopeError(child.last_words.removeprefix("rallyscope: "))
        if code != 0:
            remedy = "run `rallyscope tune` to see why"
            raise RallyscopeError("the search ended without an answer", got=child.last_words, remedy=remedy)
        return AutoTuneAnswer(load_detector(found).config, read_report(answer))


def tune_command(request: AutoTuneRequest, start: Path, found: Path) -> list[str]:
    """Command line after `python -m`."""
    words = ["app.cli", "tune", str(request.recording), "--method", request.method, "--config", str(start)]
    words += ["--parameters", ",".join(request.parameters), "--out", str(found), "--json", "--until-eof"]
    words += ["--trials", str(request.trials), "--seed", str(request.seed), *request.where]
    if not request.all_cameras:
        words += ["--camera", request.camera]
    words += ["--against", request.against]
    if request.added_us is not None:
        words += ["--streaming", "--delay-us", str(request.added_us)]
    if request.ends.events is not None:
        words += ["--window-events", str(request.ends.events)]
    if request.ends.motion_px is not None:
        words += ["--window-px", str(request.ends.motion_px)]
    if request.against == "labels":
        reference = find_reference(request.labels, request.uuid, request.camera)
        if reference is None:
            raise CommandError("this camera has no labels", got=request.camera, remedy="label it in Label first")
        words += ["--data", str(request.labels.parent), "--annotator", reference.layer.annotator]
    return words
