"""`rallyscope tune`: search for better thresholds of a detector, with half of the recording held out."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.background.child import give_way, send_to_parent
from app.cli.arguments import DATA, Names, PositiveInt, flag, positional, setting_flag
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.detect import choose_camera
from app.cli.detector_arguments import MethodArguments
from app.cli.ending import end_event
from app.cli.files import check_folder
from app.cli.labels_layer import read_layers
from app.cli.progress import progress_bar
from app.cli.streaming import StreamingArguments
from app.cli.terminal import format_table, json_ready, say
from app.cli.window_arguments import WindowArguments
from app.formatting import share_text
from core.detection.saved import SavedDetector, save_detector
from core.errors import CommandError, ConfigError
from core.files import end_with_parent
from core.recordings import Recording, open_recording
from core.tuning import (
    Objective,
    TuningConfig,
    TuningProgress,
    TuningResult,
    choose_parameters,
    report_of,
    truth_objective,
    tune,
)
from core.tuning.objective import Figures, measurably_differ
from labels.tuning_objective import Against, label_objective


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneArguments:
    """Search for better thresholds of a detector.

    Half of the recording, in blocks of time, is held out: the search never looks there, and what the thresholds are
    worth there is shown beside. Ctrl-C ends it with the best so far.
    """

    recording: Path = positional("a recording that knows the truth, or that was labelled", "REC")
    camera: str | None = flag("which camera", "NAME", "all of them")
    detector: MethodArguments
    against: Against = flag("reference: the recording's ground truth, or labels", default="truth")
    annotator: str | None = flag("whose labels; needed if there are several", "NAME")
    data: Path = flag("workspace with the labels", "DIR", DATA)
    parameters: Names | None = flag(
        "thresholds to search for, such as cluster.eps_px, or sections, such as cluster", "A,B...", "the usual ones"
    )
    windows: WindowArguments
    in_time: StreamingArguments
    trials: PositiveInt = setting_flag(TuningConfig, "trials", "N")
    seed: int = setting_flag(TuningConfig, "seed", "N")
    engine: SharedBackendArguments
    out: Path = flag("the config that was found, for --config of the verbs that detect", "FILE.toml")
    until_eof: bool = flag("exit when standard input ends (for use as a child process), and print a line per batch")
    json: bool = flag("print what was found as JSON")


def run(arguments: TuneArguments) -> None:
    """Search, write the best config, and say what it is worth."""
    check_folder(arguments.out)
    method, start = detector = arguments.detector.settings()
    config = TuningConfig(trials=arguments.trials, seed=arguments.seed)
    engine = arguments.engine.engine()
    parameters = choose_parameters(method, start, arguments.parameters)
    if arguments.until_eof:
        give_way()
        end_with_parent()
    with closing(open_recording(arguments.recording)) as recording:
        cameras = tuple(recording.cameras)
        if arguments.camera is not None:
            cameras = (choose_camera(recording, arguments.camera).name,)
        objective = _objective(arguments, detector, recording, cameras, config)
    ended = end_event()
    with _progress_output(arguments.until_eof) as progress:
        result = tune(
            objective,
            method,
            start,
            parameters,
            config,
            engine=engine,
            progress=progress,
            cancelled=ended.is_set,
        )
    if result is None:
        raise KeyboardInterrupt  # before anything was found, and nothing is written
    about = {
        "recording": str(arguments.recording),
        "cameras": list(cameras),
        "method": method,
        "against": arguments.against,
        "added_us": arguments.in_time.added_us(),
        "window_events": arguments.windows.window_events,
        "window_px": arguments.windows.window_px,
        "seed": arguments.seed,
        "asked": arguments.trials,
        "out": str(arguments.out),
    }
    try:
        save_detector(method, result.best, arguments.out)
    except ConfigError:  # what was found is said all the same: it may have taken hours
        found = json_ready({**about, "out": None} | report_of(result))
        say(json.dumps(found) if arguments.json else _describe(arguments, method, result))
        raise
    found = json_ready(about | report_of(result))
    say(json.dumps(found) if arguments.json else f"{_describe(arguments, method, result)}\nthe config: {arguments.out}")


def _objective(
    arguments: TuneArguments,
    detector: SavedDetector,
    recording: Recording,
    cameras: tuple[str, ...],
    config: TuningConfig,
) -> Objective:
    (method, start), added_us = detector, arguments.in_time.added_us()
    if arguments.against == "truth":
        if arguments.annotator is not None:
            raise CommandError("goes with --against labels", where="--annotator")
        ends = arguments.windows.ends
        return truth_objective(
            arguments.recording, recording, cameras, method, start, config, added_us=added_us, ends=ends
        )
    arguments.windows.refuse("labels are asked for whole windows", "leave it out, or take --against truth")
    if added_us is not None:
        remedy = "labels are too few to ask for the newest answer between them"
        raise CommandError("goes with --against truth", where="--streaming", remedy=remedy)
    stores = read_layers(arguments.data / "labels", recording, cameras, arguments.annotator)
    labels = {store.layer.camera: store.labels() for store in stores}
    return label_objective(arguments.recording, method, labels, config)


@contextmanager
def _progress_output(in_lines: bool) -> Iterator[Callable[[TuningProgress], None]]:
    """A bar for a person, or lines for a parent process."""
    if in_lines:
        yield lambda state: send_to_parent(_line(state))
        return
    with progress_bar("Tuning") as show:
        yield lambda state: show(state.done / state.trials)


def _line(state: TuningProgress) -> str:
    best = "" if state.best is None else f", best {state.best.tuned.objective:.4f}"
    return f"{state.done} of {state.trials} trials{best}"


def _describe(arguments: TuneArguments, method: str, result: TuningResult) -> str:
    start, best = result.trials[0], result.trials[result.best_trial]
    name = f"trial {result.best_trial}"
    rows = [
        _row("tuned on", "start", start.tuned),
        _row("", name, best.tuned),
        _row("held out", "start", start.held_out),
        _row("", name, best.held_out),
    ]
    verdict = "Nothing better was found than the config to start from."
    if result.best_trial:
        verdict = held_out_words(start.held_out, best.held_out)
    ended = f"ended early, after {len(result.trials)} of" if result.stopped else "all"
    lines = [
        f"{method} against {arguments.against}{_in_time_words(arguments)}, {ended} {arguments.trials} trials",
        format_table(rows if result.best_trial else rows[::2]),
        "",
        format_table(_parameter_rows(result)),
        "",
        verdict,
    ]
    return "\n".join(lines)


def _in_time_words(arguments: TuneArguments) -> str:
    added_us, early = arguments.in_time.added_us(), arguments.windows.ends.words
    late = "" if added_us is None else f", the newest answers {added_us} us after their windows"
    return f"{late}, windows that end {early}" if early else late


def _row(side: str, config: str, figures: Figures) -> dict[str, object]:
    return {
        "windows": side,
        "config": config,
        "precision": share_text(figures.precision),
        "recall": share_text(figures.recall),
        "median error [px]": figures.median_error_px,
        "objective": figures.objective,
    }


def _parameter_rows(result: TuningResult) -> list[dict[str, object]]:
    """The most important first, and those whose importance is not known in the config's order."""
    names = list(result.importance) or list(result.trials[0].values)
    rows = []
    for name in names:
        before, after = result.changed.get(name, (result.trials[0].values[name], None))
        rows.append(
            {
                "threshold": name,
                "start": _json_value(before),
                "found": _json_value(after),
                "importance": result.importance.get(name),
            }
        )
    return rows


def _json_value(value: object) -> object:
    return f"{value:g}" if isinstance(value, float) else value


def held_out_words(before: Figures, after: Figures) -> str:
    """Sentence on whether the found config is better than the first on the held-out side."""
    figures = f"{before.objective:.4f} before, {after.objective:.4f} now"
    if not measurably_differ(before, after):
        return f"On the held-out windows there is no measurable difference: {figures}."
    if after.objective > before.objective:
        return f"On the held-out windows it is better, too: {figures}."
    return f"On the held-out windows it is NOT better: {figures}. It fits the tuned ones only."
