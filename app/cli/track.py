"""`rallyscope track`: triangulate the ball in every window of a stereo recording and write a CSV."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.cli.arguments import flag, positional
from app.cli.detector_arguments import DetectorArguments
from app.cli.files import check_folder, write_csv
from app.cli.progress import progress_bar
from app.cli.terminal import say
from core.rally import ChainConfig
from core.rally.chain.follow import Track, follow_recording, true_positions
from core.recordings import BallTruth, open_recording


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackArguments:
    """Triangulate the ball in every window of a stereo recording."""

    recording: Path = positional("a recording with two or more calibrated cameras", "REC")
    detector: DetectorArguments
    out: Path = flag("columns t_us,x_m,y_m,z_m (world)", "CSV")
    json: bool = flag("print a summary as JSON")


def run(arguments: TrackArguments) -> None:
    """Track, write, and say what came out."""
    method, (detector, window_us) = arguments.detector.method, arguments.detector.settings()
    check_folder(arguments.out)
    config = ChainConfig.of_method(method, detector)
    with closing(open_recording(arguments.recording)) as recording:
        with progress_bar("Tracking") as progress:
            track = follow_recording(recording, config, window_us, progress=progress)
        truth = recording.ball
    write_track(arguments.out, track)
    summary = {
        "recording": str(arguments.recording),
        "method": method,
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
        say(json.dumps(summary))
        return
    say(f"{len(track.t_us)} points in {track.windows} windows of {window_us} us: {arguments.out}")
    for name, values in (("residual px", summary["residual_px"]), ("3D error mm", summary["error_mm"])):
        if isinstance(values, dict):
            say(f"{name}: median {values['median']}, p95 {values['p95']}")


def write_track(path: Path, track: Track) -> None:
    """A row per point; no row where the rays of a window do not meet."""
    points = zip(track.t_us, track.ps_world_m, strict=True)
    rows = ([t_us, *(f"{value:.6f}" for value in p)] for t_us, p in points)
    write_csv(path, ("t_us", "x_m", "y_m", "z_m"), rows)


def _errors_mm(track: Track, truth: BallTruth | None) -> dict[str, float] | None:
    if truth is None or not len(track.t_us):
        return None
    errors = np.linalg.norm(track.ps_world_m - true_positions(truth, track.t_us), axis=1)
    return _statistics(1e3 * errors[np.isfinite(errors)])


def _statistics(values: NDArray[np.float64]) -> dict[str, float] | None:
    if not len(values):
        return None
    return {"median": round(float(np.median(values)), 4), "p95": round(float(np.percentile(values, 95)), 4)}
