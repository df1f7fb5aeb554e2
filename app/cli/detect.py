"""`rallyscope detect`: find the ball in every window, or picture, of one camera and write a CSV."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from app.cli.arguments import flag, given, one_of, positional, whole_number
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.detector_arguments import AnyMethodArguments
from app.cli.files import csv_text
from app.cli.rimless import rimless_summary, say_rimless
from app.cli.streaming import StreamingArguments, plain_score, say_streaming, score_without_delay, with_streaming
from app.cli.tabulate import RecordingTable, Summary, tabulate
from app.cli.terminal import format_table, print_lines, say
from app.cli.window_arguments import WindowArguments, length_words, window_lengths
from core.detection import DetectorConfig, RefinedDetection, make_detector
from core.detection.method_trace import CandidateRow, MethodTrace
from core.detection.methods import FRAME_METHODS, Method
from core.detection.reasons import FIXED, Reason, ReasonCount, ReasonCounter, number_text
from core.detection.refined.detector import estimate_delay
from core.detection.window import WindowConfig, WindowRule
from core.errors import CommandError
from core.jobs import TaskControl
from core.metrics import WindowAnswers, run_detector, score_answers
from core.metrics.run import TimedDetector, duration_of, explain_window, one_opencv_thread, run_on_frames
from core.recordings import CameraStream, PixelTruth, Recording, open_recording
from core.recordings.frames import FrameStream, window_of
from core.recordings.reader import FileRecording

WARM_UP_US: Final = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectArguments:
    """Find the ball in every window of one camera, or in every picture, of one recording or of several."""

    recordings: tuple[Path, ...] = positional("recordings or event files", "REC")
    camera: str | None = flag("which camera; needed if there are several", "NAME")
    detector: AnyMethodArguments
    windows: WindowArguments
    wanted: tuple[str, str] = one_of(
        {
            "out": ("columns t_us,u_px,v_px,r_px; of several recordings a folder with a CSV of each", "CSV|DIR"),
            "explain": (
                "instead of a table of all: the window that ends there, each stage, candidate and failed limit",
                "T_US",
            ),
        }
    )
    in_time: StreamingArguments
    engine: SharedBackendArguments
    json: bool = flag("print a summary as JSON")


def run(arguments: DetectArguments) -> None:
    """Detect, write, and say what came out."""
    frames = arguments.detector.frame_method
    kind, value = arguments.wanted
    if kind == "explain":
        _explain(arguments, _time_of(value))
        return
    work = _find_in_events(arguments) if frames is None else _find_in_frames(arguments, frames)
    tabulate(arguments.recordings, Path(value), work, arguments.engine, "Detecting", arguments.json, _say)


def _say(summary: Summary) -> None:
    score, what = summary["score"], "pictures" if summary["method"] in FRAME_METHODS else "windows"
    found = f"{summary['detections']} detections in {summary['windows']} {what} of {length_words(summary)}"
    say(f"{found}: {summary['out']}")
    if isinstance(score, dict):
        say(f"precision {score['precision']}, recall {score['recall']}, median error {score['median_error_px']} px")
    fair = summary.get("score_without_delay")
    if isinstance(fair, dict):
        say(f"with one delay of {fair['delay_us']} us taken out: median error {fair['median_error_px']} px")
    in_time = summary.get("streaming")
    if isinstance(in_time, dict):
        say_streaming(in_time)
    counts, windows, found = summary["why_not"], summary["windows"], summary["detections"]
    assert isinstance(counts, list) and isinstance(windows, int) and isinstance(found, int)
    say_why_not(counts, windows - found, what)
    say_rimless(summary)


def _time_of(text: str) -> int:
    """A time in us; raises CommandError if it is none."""
    try:
        return whole_number(text)
    except (argparse.ArgumentTypeError, ValueError) as error:
        raise CommandError("not a time", expected="whole us", got=repr(text), where="--explain") from error


def _explain(arguments: DetectArguments, t_us: int) -> None:
    """Print the table of one window of one recording.

    Raises:
        CommandError: for several recordings, or a time outside the recording.
    """
    path, *others = arguments.recordings
    if others:
        raise CommandError("one window of which recording?", expected="one recording", where="--explain")
    asked = arguments.detector
    arguments.windows.refuse("one window is explained, of the length of --window-us", "leave it out")
    with closing(open_recording(path)) as recording:
        if asked.frame_method is not None:
            name, title, trace = _explain_picture(recording, arguments, t_us)
        else:
            method, config, window_us = asked.settings()
            config = dataclasses.replace(config, window=WindowConfig(window_us=window_us))
            stream = choose_camera(recording, arguments.camera)
            if not 0 < t_us <= (end_us := duration_of(stream)):
                raise CommandError("no window ends there", expected=f"1 to {end_us}", got=t_us, where="--explain")
            answer = explain_window(stream, method, config, t_us)
            name, trace, window = stream.name, answer.trace, answer.window
            title = f"{name}, {method}: window {window.start_us} to {window.end_us} us"
    assert trace is not None
    if arguments.json:
        say(json.dumps({"camera": name, "t_us": t_us, **trace_summary(trace)}))
    else:
        say_trace(trace, title)


def _explain_picture(recording: FileRecording, arguments: DetectArguments, t_us: int) -> tuple[str, str, MethodTrace]:
    """Camera, title and trace of the picture whose exposure is nearest to a time; raises CommandError for none."""
    name, frames = choose_pictures(recording, arguments.camera)
    from core.detection.yolo.detector import YoloDetector  # late, as below
    from core.detection.yolo.weights import load_weights

    nearest = int(np.abs(frames.t_us - t_us).argmin())
    window = window_of(frames.frame(nearest))
    trace = YoloDetector(load_weights(arguments.detector.weights)).explain(window)
    return name, f"{name}, {arguments.detector.frame_method}: picture at {int(frames.t_us[nearest])} us", trace


def _find_in_events(arguments: DetectArguments) -> DetectInEvents:
    method, config, window_us = arguments.detector.settings()
    rule = arguments.windows.ends.within(window_us)
    return DetectInEvents(arguments.camera, method, config, rule, arguments.in_time.added_us())


def _find_in_frames(arguments: DetectArguments, method: str) -> DetectInFrames:
    """Raises CommandError for a flag that is of windows of events."""
    asked = arguments.detector
    for name, value in given({"config": asked.config, "window-us": asked.window_us}).items():
        remedy = "leave it out: all settings of yolo are in its weights, and a picture is a window"
        raise CommandError(f"{method} has no such setting", got=value, where=f"--{name}", remedy=remedy)
    arguments.windows.refuse(f"{method} has no windows of events", "leave it out: a picture is a window")
    weights = asked.weights and asked.weights.absolute()
    return DetectInFrames(arguments.camera, method, weights, arguments.in_time.added_us())


@dataclass(frozen=True, slots=True)
class DetectInEvents:
    """The table and the summary of a recording, from all windows of a camera."""

    camera: str | None
    method: Method
    config: DetectorConfig
    windows: WindowRule
    added_us: int | None
    """Delay besides computing, for a score in time; None without one."""

    def __call__(self, path: Path, control: TaskControl) -> RecordingTable:
        """Detect."""
        with closing(open_recording(path)) as recording:
            stream = choose_camera(recording, self.camera)
            detector = TimedDetector(make_detector(self.method, stream.sensor, self.config))
            with one_opencv_thread() if self.added_us is not None else nullcontext():
                if self.added_us is not None:  # its code is loaded before the first window that is timed
                    run_detector(stream, detector, self.windows, end_us=WARM_UP_US)
                    detector.seconds.clear()
                reasons = ReasonCounter()
                answers = run_detector(stream, detector, self.windows, progress=control, reasons=reasons)
            table = _table(stream.name, self.method, self.windows.longest_us, answers, stream.truth, reasons)
            fair = score_without_delay(answers, stream.truth, stream.sensor)
            rimless = {} if answers.detected.any() else rimless_summary(stream)
            table = RecordingTable(table.text, table.summary | window_lengths(self.windows, answers) | fair | rimless)
            return with_streaming(table, answers, stream.truth, detector, self.added_us)


@dataclass(frozen=True, slots=True)
class DetectInFrames:
    """Detections in every picture of a frame camera."""

    camera: str | None
    method: str
    weights: Path | None
    added_us: int | None
    """As of events."""

    def __call__(self, path: Path, control: TaskControl) -> RecordingTable:
        """Detect; raises CommandError if there are no pictures."""
        with closing(open_recording(path)) as recording:
            name, frames = choose_pictures(recording, self.camera)
            from core.detection.yolo.detector import YoloDetector  # late: torch takes a second, a mistake should not
            from core.detection.yolo.weights import load_weights

            detector = TimedDetector(YoloDetector(load_weights(self.weights)))
            reasons = ReasonCounter()
            answers = run_on_frames(frames, detector, progress=control, reasons=reasons)
            truth = recording.cameras[name].truth if name in recording.cameras else None
            table = _table(name, self.method, int(np.median(frames.exposure_us)), answers, truth, reasons)
            return with_streaming(table, answers, truth, detector, self.added_us)


def choose_pictures(recording: FileRecording, name: str | None) -> tuple[str, FrameStream]:
    """The pictures of the camera of that name, or of the only one that has some.

    Raises:
        CommandError: if there are none, or no name and several cameras.
    """
    there = {camera: frames for camera, frames in recording.frames.items() if len(frames)}
    if name is None and len(there) > 1:
        raise CommandError("which camera?", expected=f"--camera with one of {', '.join(there)}")
    name = name or next(iter(there), None)
    if name is None or name not in there:
        remedy = "take some with `rallyscope simulate --frames-hz 30`, or add them with `rallyscope import --frames`"
        where = "the recording" if name is None else f"camera {name}"
        known = f"one of {', '.join(there)}" if there else None
        raise CommandError("no pictures", expected=known, where=where, remedy=remedy)
    return name, there[name]


def choose_camera(recording: Recording, name: str | None) -> CameraStream:
    """The camera of that name, or the only one.

    Raises:
        CommandError: if there is none of that name, or no name and several cameras.
    """
    known = ", ".join(recording.cameras)
    if name is None:
        if len(recording.cameras) != 1:
            raise CommandError("which camera?", expected=f"--camera with one of {known}")
        return next(iter(recording.cameras.values()))
    if name not in recording.cameras:
        raise CommandError(f"no camera {name!r}", expected=f"one of {known}", where="--camera")
    return recording.cameras[name]


def _table(
    camera: str,
    method: str,
    window_us: int,
    answers: WindowAnswers,
    truth: PixelTruth | None,
    reasons: ReasonCounter,
) -> RecordingTable:
    """A row per detection; no row for a window without a ball."""
    rows = []
    for row in np.flatnonzero(answers.detected):
        place = (answers.u_px[row], answers.v_px[row], answers.r_px[row])
        rows.append([answers.t_us[row], *(f"{value:.4f}" for value in place)])
    summary: Summary = {
        "camera": camera,
        "method": method,
        "window_us": window_us,
        "windows": len(answers.end_us),
        "detections": int(answers.detected.sum()),
        "extra_circles": int(answers.extra_circles.sum()),
        "score": None if truth is None else plain_score(score_answers(answers, truth)),
        "why_not": why_not_summary(reasons),
        **_motion([one for one in answers.detections if isinstance(one, RefinedDetection)]),
    }
    return RecordingTable(csv_text(("t_us", "u_px", "v_px", "r_px"), rows), summary)


def _motion(balls: list[RefinedDetection]) -> Summary:
    """What `refined` says beside the columns of the file, in its order, and of the sensor."""
    if not balls:
        return {}
    delay = estimate_delay(balls)
    return {
        "motion": {
            "t_us": [one.t_us for one in balls],
            "vu_px_per_ms": [round(one.vu_px_per_ms, 4) for one in balls],
            "vv_px_per_ms": [round(one.vv_px_per_ms, 4) for one in balls],
            "covariance": [np.round(one.covariance, 6).tolist() for one in balls],
        },
        "sensor_delay": None if delay is None else delay._asdict(),
    }


LISTED: Final = 6
"""Most reasons printed for a recording."""
DIGITS: Final = 6
ROWS: Final = 40
"""Most candidates printed for a window."""


def why_not_summary(counter: ReasonCounter) -> list[dict[str, object]]:
    """Plain values of every reason, the most frequent first. A setting of None: the limit is fixed."""
    return [
        {
            "reason": one.reason,
            "setting": one.setting,
            "windows": one.windows,
            "value": None if one.value is None else round(one.value, DIGITS),
            "limit": None if one.limit is None else round(one.limit, DIGITS),
        }
        for one in counter.counts()
    ]


def say_why_not(counts: Sequence[dict[str, object]], windows: int, what: str) -> None:
    """Print the most frequent reasons of that many windows without a ball; nothing if all have one."""
    if not counts or not windows:
        return
    say(f"no ball in {windows} {what}; limits that the nearest candidate failed:")
    rows: list[dict[str, object]] = [
        {
            "share": f"{100 * _number(one['windows']) / windows:.0f} %",
            "reason": one["reason"],
            "median": _text(one["value"]),
            "limit": _text(one["limit"]),
            "setting": one["setting"] or FIXED,
        }
        for one in counts[:LISTED]
    ]
    print_lines(format_table(rows).split("\n"))


def say_trace(trace: MethodTrace, title: str) -> None:
    """Print the table of one window: what came into each stage and out of it, the candidates, the answer."""
    say(title)
    stages: list[dict[str, object]] = [
        {
            "stage": name,
            "in": "-" if count.not_run else f"{count.count_in} {count.unit_in or count.unit}",
            "out": count.not_run or f"{count.count_out} {count.unit}",
            "ms": "-" if count.seconds is None else f"{1e3 * count.seconds:.2f}",
        }
        for name, count in trace.counts.items()
    ]
    print_lines(format_table(stages).split("\n"))
    ordered = sorted(trace.candidates, key=lambda one: (bool(one.reasons), -one.order))
    if ordered:
        say()
        print_lines(format_table([_candidate(one, trace) for one in ordered[:ROWS]]).split("\n"))
    if len(ordered) > ROWS:
        say(f"and {len(ordered) - ROWS} more")
    say()
    ball = trace.detection
    if ball is not None:
        say(f"ball at ({ball.u_px:.2f}, {ball.v_px:.2f}) px, radius {ball.r_px:.2f} px, valid at {ball.t_us} us")
        return
    say("no ball: " + "; ".join(f"{one.text} ({one.setting or FIXED})" for one in trace.reasons))


def trace_summary(trace: MethodTrace) -> dict[str, object]:
    """Plain values of the table of one window."""
    ball = trace.detection
    return {
        "detection": None if ball is None else {name: getattr(ball, name) for name in ("t_us", "u_px", "v_px", "r_px")},
        "stages": [
            {"stage": name, "in": one.count_in, "out": one.count_out, "unit": one.unit, "seconds": one.seconds}
            for name, one in trace.counts.items()
        ],
        "candidates": [
            {
                trace.noun: one.label,
                **dict(zip(trace.titles, one.figures, strict=True)),
                "verdict": "rejected" if one.reasons else one.verdict,
                "reasons": [_reason(reason) for reason in one.reasons],
            }
            for one in trace.candidates
        ],
        "why_not": [_reason(reason) for reason in trace.reasons],
    }


def _reason(reason: Reason | ReasonCount) -> dict[str, object]:
    return {"reason": reason.reason, "setting": reason.setting, "value": reason.value, "limit": reason.limit}


def _candidate(row: CandidateRow, trace: MethodTrace) -> dict[str, object]:
    why = "; ".join(f"{one.text} ({one.setting or FIXED})" for one in row.reasons)
    return {trace.noun: row.label, **dict(zip(trace.titles, row.figures, strict=True)), "verdict": why or row.verdict}


def _number(value: object) -> float:
    assert isinstance(value, (int, float))
    return float(value)


def _text(value: object) -> str:
    return "-" if value is None else number_text(_number(value))
