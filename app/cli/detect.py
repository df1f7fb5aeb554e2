"""`rallyscope detect`: find the ball in every window, or picture, of one camera and write a CSV."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from app.cli.arguments import flag, given, positional
from app.cli.detector_arguments import AnyMethodArguments
from app.cli.files import check_folder, write_csv
from app.cli.progress import progress_bar
from app.cli.terminal import say
from core.detection import RefinedDetection, make_detector
from core.detection.methods import FRAME_METHODS
from core.detection.refined.sensor_delay import estimate_delay
from core.errors import CommandError
from core.metrics import WindowAnswers, run_detector, score_answers
from core.metrics.run import run_on_frames
from core.recordings import CameraStream, PixelTruth, Recording, open_recording
from core.recordings.frames import FrameStream
from core.recordings.reader import FileRecording


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectArguments:
    """Find the ball in every window of one camera, or in every picture."""

    recording: Path = positional("a recording or an event file", "REC")
    camera: str | None = flag("which camera; needed if there are several", "NAME")
    detector: AnyMethodArguments
    out: Path = flag("columns t_us,u_px,v_px,r_px", "CSV")
    json: bool = flag("print a summary as JSON")


def run(arguments: DetectArguments) -> None:
    """Detect, write, and say what came out."""
    on_frames = arguments.detector.method in FRAME_METHODS
    find = _find_in_frames if on_frames else _find_in_events
    check_folder(arguments.out)
    with closing(open_recording(arguments.recording)) as recording:
        found = find(arguments, recording)
        write_detections(arguments.out, found.answers)
        summary = _summarise(arguments, found)
    if arguments.json:
        say(json.dumps(summary))
        return
    score, what = summary["score"], "pictures" if on_frames else "windows"
    say(f"{summary['detections']} detections in {summary['windows']} {what} of {found.window_us} us: {arguments.out}")
    if isinstance(score, dict):
        say(f"precision {score['precision']}, recall {score['recall']}, median error {score['median_error_px']} px")


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    camera: str
    truth: PixelTruth | None
    answers: WindowAnswers
    window_us: int
    """Of a picture its exposure."""


def _find_in_events(arguments: DetectArguments, recording: FileRecording) -> _Found:
    """The answers to all windows."""
    method, config, window_us = arguments.detector.settings()
    stream = choose_camera(recording, arguments.camera)
    detector = make_detector(method, stream.sensor, config)
    with progress_bar("Detecting") as progress:
        answers = run_detector(stream, detector, window_us, progress=progress)
    return _Found(stream.name, stream.truth, answers, window_us)


def _find_in_frames(arguments: DetectArguments, recording: FileRecording) -> _Found:
    """The answers to all pictures.

    Raises:
        CommandError: if there are none, or for a flag that is of windows of events.
    """
    asked = arguments.detector
    for name, value in given({"config": asked.config, "window-us": asked.window_us}).items():
        remedy = "leave it out: all settings of yolo are in its weights, and a picture is a window"
        raise CommandError(f"{asked.method} has no such setting", got=value, where=f"--{name}", remedy=remedy)
    name, frames = choose_pictures(recording, arguments.camera)
    from core.detection.yolo.detector import YoloDetector  # late: torch takes a second, a mistake should not
    from core.detection.yolo.weights import load_weights

    detector = YoloDetector(load_weights(asked.weights))
    with progress_bar("Detecting") as progress:
        answers = run_on_frames(frames, detector, progress=progress)
    truth = recording.cameras[name].truth if name in recording.cameras else None
    return _Found(name, truth, answers, int(np.median(frames.exposure_us)))


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
        remedy = "take some with `rallyscope simulate --frames`, or add them with `rallyscope import --frames`"
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


def write_detections(path: Path, answers: WindowAnswers) -> None:
    """A row per detection; no row for a window without a ball."""
    rows = []
    for row in np.flatnonzero(answers.detected):
        place = (answers.u_px[row], answers.v_px[row], answers.r_px[row])
        rows.append([answers.t_us[row], *(f"{value:.4f}" for value in place)])
    write_csv(path, ("t_us", "u_px", "v_px", "r_px"), rows)


def _summarise(arguments: DetectArguments, found: _Found) -> dict[str, object]:
    score, answers = None, found.answers
    if found.truth is not None:
        numbers = asdict(score_answers(answers, found.truth))
        score = {name: None if number != number else round(number, 4) for name, number in numbers.items()}
    return {
        "recording": str(arguments.recording),
        "camera": found.camera,
        "method": arguments.detector.method,
        "window_us": found.window_us,
        "windows": len(answers.end_us),
        "detections": int(answers.detected.sum()),
        "extra_circles": int(answers.extra_circles.sum()),
        "score": score,
        "out": str(arguments.out),
        **_motion([one for one in answers.detections if isinstance(one, RefinedDetection)]),
    }


def _motion(balls: list[RefinedDetection]) -> dict[str, object]:
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
