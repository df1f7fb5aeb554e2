"""`rallyscope track`: triangulate the ball in every window of a stereo recording and write a CSV."""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.cli.detector_arguments import add_detector_arguments, detector_of
from app.cli.progress import progress_bar
from core.errors import CommandError
from core.rally import ChainConfig
from core.rally.chain.follow import Track, follow_recording, true_positions
from core.recordings import BallTruth, open_recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("recording", type=Path, metavar="REC", help="a recording with two or more calibrated cameras")
    add_detector_arguments(parser, "t_us,x_m,y_m,z_m (world)")


def run(arguments: argparse.Namespace) -> None:
    """Track, write, and say what came out."""
    detector, window_us = detector_of(arguments)
    config = ChainConfig(method=arguments.method, detector=detector)
    recording = open_recording(arguments.recording)
    try:
        with progress_bar("Tracking") as progress:
            track = follow_recording(recording, config, window_us, progress=progress)
        truth = recording.ball
    finally:
        recording.close()
    write_track(arguments.out, track)
    summary = {
        "recording": str(arguments.recording),
        "method": arguments.method,
        "window_us": window_us,
        "windows": track.windows,
        "seen_by_all_cameras": track.seen_by_all,
        "points": len(track.t_us),
        "residual_px": _statistics(track.residuals_px),
        "error_mm": _errors_mm(track, truth),
        "step_ms": _statistics(1e3 * track.step_s),
        "out": str(arguments.out),
    }
    if arguments.json:
        print(json.dumps(summary))
        return
    print(f"{len(track.t_us)} points in {track.windows} windows of {window_us} us: {arguments.out}")
    for name, values in (("residual px", summary["residual_px"]), ("3D error mm", summary["error_mm"])):
        if isinstance(values, dict):
            print(f"{name}: median {values['median']}, p95 {values['p95']}")


def write_track(path: Path, track: Track) -> None:
    """A row per point; no row where the rays of a window do not meet."""
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["t_us", "x_m", "y_m", "z_m"])
            for t_us, p in zip(track.t_us, track.ps_world_m, strict=True):
                writer.writerow([t_us, *(f"{value:.6f}" for value in p)])
    except OSError as error:
        raise CommandError(f"cannot write: {error.strerror}", where=path) from error


def _errors_mm(track: Track, truth: BallTruth | None) -> dict[str, float] | None:
    if truth is None or not len(track.t_us):
        return None
    errors = np.linalg.norm(track.ps_world_m - true_positions(truth, track.t_us), axis=1)
    return _statistics(1e3 * errors[np.isfinite(errors)])


def _statistics(values: NDArray[np.float64]) -> dict[str, float] | None:
    if not len(values):
        return None
    return {"median": round(float(np.median(values)), 4), "p95": round(float(np.percentile(values, 95)), 4)}
