"""`rallyscope detect`: find the ball in every window of one camera and write a CSV."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from app.cli.arguments import flag, positional
from app.cli.detector_arguments import DetectorArguments
from app.cli.files import check_folder, write_csv
from app.cli.progress import progress_bar
from core.detection import RefinedDetection, make_detector
from core.detection.refined.sensor_delay import estimate_delay
from core.errors import CommandError
from core.metrics import WindowAnswers, run_detector, score_answers
from core.recordings import CameraStream, Recording, open_recording


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectArguments:
    """Find the ball in every window of one camera."""

    recording: Path = positional("a recording or an event file", "REC")
    camera: str | None = flag("which camera; needed if there are several", "NAME")
    detector: DetectorArguments
    out: Path = flag("columns t_us,u_px,v_px,r_px", "CSV")
    json: bool = flag("print a summary as JSON")


def run(arguments: DetectArguments) -> None:
    """Detect, write, and say what came out."""
    method, (config, window_us) = arguments.detector.method, arguments.detector.settings()
    check_folder(arguments.out)
    with closing(open_recording(arguments.recording)) as recording:
        stream = choose_camera(recording, arguments.camera)
        detector = make_detector(method, stream.sensor, config)
        with progress_bar("Detecting") as progress:
            answers = run_detector(stream, detector, window_us, progress=progress)
        write_detections(arguments.out, answers)
        summary = _summarise(arguments, stream, window_us, answers)
    if arguments.json:
        print(json.dumps(summary))
        return
    score = summary["score"]
    print(f"{summary['detections']} detections in {summary['windows']} windows of {window_us} us: {arguments.out}")
    if isinstance(score, dict):
        print(f"precision {score['precision']}, recall {score['recall']}, median error {score['median_error_px']} px")


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


def _summarise(
    arguments: DetectArguments, stream: CameraStream, window_us: int, answers: WindowAnswers
) -> dict[str, object]:
    score = None
    if stream.truth is not None:
        numbers = asdict(score_answers(answers, stream.truth))
        score = {name: None if number != number else round(number, 4) for name, number in numbers.items()}
    return {
        "recording": str(arguments.recording),
        "camera": stream.name,
        "method": arguments.detector.method,
        "window_us": window_us,
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
