"""`rallyscope track`: triangulate the ball in every window with all cameras that see it, and write a CSV."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.cli.arguments import flag, positional
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.constants import CONSTANTS_OF_BALL, given_constants
from app.cli.detector_arguments import DetectorArguments
from app.cli.files import csv_text
from app.cli.tabulate import RecordingTable, Summary, tabulate
from app.cli.terminal import say
from app.shared.frame_detector import frame_detector
from core.cameras import Camera
from core.chain import ChainConfig
from core.chain.calibration_drift import DriftReport
from core.chain.config import PREDICTIONS, PredictionName, chain_with_constants, with_prediction
from core.chain.follow import Track, calibrated_cameras, follow_recording, frame_cameras, true_positions
from core.detection import DetectorConfig
from core.detection.methods import Method
from core.jobs import TaskControl
from core.physics.constants_file import FittedConstants
from core.physics.flight_motion import FALLS_MPS2, fall_of_flights
from core.recordings import BallTruth, open_recording
from core.text import counted

FEWEST_SEEN = 20
"""Windows with a ball in every camera from which on it is said that their rays do not meet."""
MEETING_SHARE = 0.5
LARGEST_RESIDUAL_PX = 1.0
"""Median of the points of a rig that fits; `ebpp` has 0.46 px on a simulated serve, more than any other method."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackArguments:
    """Triangulate the ball in every window of a recording, or of several, with all cameras that see it."""

    recordings: tuple[Path, ...] = positional("recordings with two or more calibrated cameras", "REC")
    detector: DetectorArguments
    prediction: PredictionName = flag(
        "of the flight, which moves points that one camera of three or more sees alone: filter does, paper does not",
        "|".join(PREDICTIONS),
        "filter",
        choices=PREDICTIONS,
    )
    constants: Path | None = flag(CONSTANTS_OF_BALL, "FILE")
    events_only: bool = flag("leave out the pictures of calibrated frame cameras, in which yolo looks for the ball")
    out: Path = flag(
        "columns t_us,x_m,y_m,z_m (world) and cameras (of which a point is made, joined by +); of several recordings a "
        "folder with a CSV of each",
        "CSV|DIR",
    )
    engine: SharedBackendArguments
    json: bool = flag("print a summary as JSON")


def run(arguments: TrackArguments) -> None:
    """Track, write, and say what came out."""
    constants = given_constants(arguments.constants, prediction=arguments.prediction)
    work = TrackRecording(*arguments.detector.settings(), arguments.prediction, constants, arguments.events_only)
    tabulate(arguments.recordings, arguments.out, work, arguments.engine, "Tracking", arguments.json, _say)


@dataclass(frozen=True, slots=True)
class TrackRecording:
    """The table and the summary of a recording."""

    method: Method
    detector: DetectorConfig
    window_us: int
    prediction: PredictionName = "filter"
    constants: FittedConstants | None = None
    """Fitted air and table; None: they are learned."""
    events_only: bool = False
    """Whether frame cameras are left out."""

    def __call__(self, path: Path, control: TaskControl) -> RecordingTable:
        """Track."""
        config = with_prediction(ChainConfig.of_method(self.method, self.detector), self.prediction)
        config = config if self.constants is None else chain_with_constants(config, self.constants)
        with closing(open_recording(path)) as recording:
            make = None if self.events_only else frame_detector()
            track = follow_recording(recording, config, self.window_us, frame_detector=make, progress=control)
            truth, frames = recording.ball, () if make is None else tuple(frame_cameras(recording))
            names = (*recording.cameras, *frames)
            cameras = calibrated_cameras(recording)
        summary: Summary = {
            "method": self.method,
            "window_us": self.window_us,
            "windows": track.windows,
            "seen_by_all_cameras": track.seen_by_all,
            "points": len(track.t_us),
            "points_of_camera": {name: sum(name in used for used in track.cameras) for name in names},
            "points_of_cameras": dict(sorted(Counter(len(used) for used in track.cameras).items(), reverse=True)),
            "single_pixels_of_camera": {name: track.single.get(name, 0) for name in names},
            "frame_cameras": list(frames),
            "residual_px": _statistics(track.residuals_px),
            "error_mm": _errors_mm(track, truth),
            "step_ms": _statistics(1e3 * track.step_s),
            "calibration": _calibration(track.drift),
            "notes": [*odd_rays(track), *odd_fall(track, cameras)],
        }
        return RecordingTable(_text(track), summary)


def _calibration(report: DriftReport) -> dict[str, object] | None:
    """Drift of the calibration at the worst pair of cameras; None with too few points to know."""
    if report.drift is None or report.pair is None:
        return None
    drift = {"worst_pair": list(report.pair), "drift_px": round(report.drift.drift_px, 3)}
    return {**drift, "alarm": report.alarm, "moved_camera": report.camera}


def odd_rays(track: Track) -> list[str]:
    """Lines about rays of the cameras that do not meet, or by too much, or of which there are none."""
    seen, points = track.seen_by_all, len(track.t_us)
    causes = "the calibration, the order of the cameras (--names) or their clocks (--offset-us) may be wrong"
    if not seen and not points:
        return ["no window has a ball in every camera: see `rallyscope detect --camera NAME`"]
    if seen >= FEWEST_SEEN and points < MEETING_SHARE * seen:
        where = counted(seen, "window")
        return [f"every camera sees a ball in {where}, but their rays meet in {points} only: {causes}"]
    residual_px = float(np.median(track.residuals_px)) if points else 0.0
    if points >= FEWEST_SEEN and residual_px > LARGEST_RESIDUAL_PX:
        return [f"the rays of the cameras miss each other by {residual_px:.2g} px (median): {causes}"]
    return []


def odd_fall(track: Track, cameras: Mapping[str, Camera]) -> list[str]:
    """A line if the ball falls upwards in a world that is not just a camera's frame."""
    if any(np.array_equal(camera.T_world_camera, np.eye(4)) for camera in cameras.values()):
        return []
    fall_mps2 = fall_of_flights(1e-6 * track.t_us.astype(np.float64), track.ps_world_m)
    if fall_mps2 is None or not FALLS_MPS2[0] <= -fall_mps2 <= FALLS_MPS2[1]:
        return []
    # Pictures of both cameras counted from the bottom meet as well as others where the cameras stand level.
    text = "does the calibration count rows from the bottom of the picture, or does its z point down?"
    return [f"the ball falls upwards, with {-fall_mps2:.2g} m/s2: {text}"]


def _say(summary: Summary) -> None:
    say(f"{summary['points']} points in {summary['windows']} windows of {summary['window_us']} us: {summary['out']}")
    for name, values in (("residual px", summary["residual_px"]), ("3D error mm", summary["error_mm"])):
        if isinstance(values, dict):
            say(f"{name}: median {values['median']}, p95 {values['p95']}")
    calibration = summary["calibration"]
    if isinstance(calibration, dict) and calibration["alarm"]:
        pair = " and ".join(calibration["worst_pair"])
        moved = f"{calibration['moved_camera']} was moved" if calibration["moved_camera"] else "one of them was moved"
        say(f"the calibration is off by {calibration['drift_px']} px between {pair}: {moved}, calibrate again")
    frames, single = summary["frame_cameras"], summary["single_pixels_of_camera"]
    if isinstance(frames, list) and isinstance(single, dict) and frames:
        say("pictures that moved the flight: " + ", ".join(f"{single[name]} of {name}" for name in frames))
    notes = summary["notes"]
    for note in notes if isinstance(notes, list) else ():
        say(note)
    counts = summary["points_of_cameras"]
    if isinstance(counts, dict) and summary["points"] and max(counts) > 2:
        say("points by number of cameras: " + ", ".join(f"{count} of {cameras}" for cameras, count in counts.items()))


def _text(track: Track) -> str:
    """A row per point; no row where the rays of a window do not meet."""
    points = zip(track.t_us, track.ps_world_m, track.cameras, strict=True)
    rows = ([t_us, *(f"{value:.6f}" for value in p), "+".join(used)] for t_us, p, used in points)
    return csv_text(("t_us", "x_m", "y_m", "z_m", "cameras"), rows)


def _errors_mm(track: Track, truth: BallTruth | None) -> dict[str, float] | None:
    if truth is None or not len(track.t_us):
        return None
    errors = np.linalg.norm(track.ps_world_m - true_positions(truth, track.t_us), axis=1)
    return _statistics(1e3 * errors[np.isfinite(errors)])


def _statistics(values: NDArray[np.float64]) -> dict[str, float] | None:
    if not len(values):
        return None
    return {"median": round(float(np.median(values)), 4), "p95": round(float(np.percentile(values, 95)), 4)}
