"""`rallyscope detect`: find the ball in every window of one camera and write a CSV."""

from __future__ import annotations

import argparse
import csv
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from app.cli.detector_arguments import add_detector_arguments, detector_of
from app.cli.progress import progress_bar
from core.detection import make_detector
from core.errors import CommandError
from core.metrics import WindowAnswers, run_detector, score_answers
from core.recordings import CameraStream, Recording, open_recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("recording", type=Path, metavar="REC", help="a recording or an event file")
    parser.add_argument("--camera", metavar="NAME", help="which camera; needed if there are several")
    add_detector_arguments(parser, "t_us,u_px,v_px,r_px")


def run(arguments: argparse.Namespace) -> None:
    """Detect, write, and say what came out."""
    config, window_us = detector_of(arguments)
    recording = open_recording(arguments.recording)
    try:
        stream = choose_camera(recording, arguments.camera)
        detector = make_detector(arguments.method, stream.sensor, config)
        with progress_bar("Detecting") as progress:
            answers = run_detector(stream, detector, window_us, progress=progress)
        write_detections(arguments.out, answers)
        summary = _summarise(arguments, stream, window_us, answers)
    finally:
        recording.close()
    if arguments.json:
        print(json.dumps(summary))
    else:
        score = summary["score"]
        print(f"{summary['detections']} detections in {summary['windows']} windows of {window_us} us: {arguments.out}")
        if isinstance(score, dict):
            print(
                f"precision {score['precision']}, recall {score['recall']}, median error {score['median_error_px']} px"
            )


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
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["t_us", "u_px", "v_px", "r_px"])
            for row in np.flatnonzero(answers.detected):
                place = (answers.u_px[row], answers.v_px[row], answers.r_px[row])
                writer.writerow([answers.t_us[row], *(f"{value:.4f}" for value in place)])
    except OSError as error:
        raise CommandError(f"cannot write: {error.strerror}", where=path) from error


def _summarise(
    arguments: argparse.Namespace, stream: CameraStream, window_us: int, answers: WindowAnswers
) -> dict[str, object]:
    score = None
    if stream.truth is not None:
        numbers = asdict(score_answers(answers, stream.truth))
        score = {name: None if number != number else round(number, 4) for name, number in numbers.items()}
    return {
        "recording": str(arguments.recording),
        "camera": stream.name,
        "method": arguments.method,
        "window_us": window_us,
        "windows": len(answers.end_us),
        "detections": int(answers.detected.sum()),
        "extra_circles": int(answers.extra_circles.sum()),
        "score": score,
        "out": str(arguments.out),
    }
