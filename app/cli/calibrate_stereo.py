"""`rallyscope calibrate stereo`: poses, clocks and scale of a rig from a ball or a wand that was swept before it."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from app.cli.arguments import PositiveInt, flag, positional, setting_flag
from app.cli.calibrate_intrinsics import check_destinations
from app.cli.cameras import noted_calibration
from app.cli.detector_arguments import MethodArguments
from app.cli.progress import progress_bar
from app.cli.rig_output import write_rig
from core.cameras import Camera
from core.cameras.calibration.body_tracks import body_tracks
from core.cameras.calibration.free_fall import REAL_DRAG_PER_M
from core.cameras.calibration.point_track import PointTrack, read_point_track
from core.cameras.calibration.rig import RigConfig, calibrate_rig
from core.cameras.calibration.scale import KINDS, Scale
from core.cameras.calibration.table_corners import CORNERS, read_clicks
from core.cameras.units import FARTHEST_M, NEAREST_M, likely_unit
from core.detection import make_detector
from core.errors import CommandError
from core.metrics import run_detector
from core.physics.config import Profile
from core.recordings import Recording, calibrations_of, open_recording

DETECTING = 0.7
"""Share of the time that the detector takes."""
LIKELY_WAND_M = (0.02, 5.0)
SCALE_FORM = "baseline=METRES|wand=METRES|gravity|table"


def named_paths(text: str) -> dict[str, Path]:
    """`left=FILE,right=FILE` as argparse's type."""
    named: dict[str, Path] = {}
    for part in text.split(","):
        name, _, path = (word.strip() for word in part.partition("="))
        if not name or not path or name in named:
            raise argparse.ArgumentTypeError(f"expected NAME=FILE,NAME=FILE, got {text!r}")
        named[name] = Path(path)
    return named


NamedPaths = Annotated[dict[str, Path], named_paths]


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoArguments:
    """Poses, clocks and scale of two or more cameras, from a ball or a wand swept before them."""

    recording: Path | None = positional("a recording of the sweep; not needed with --detections", "REC")
    swept: Literal["ball", "wand"] = flag("what was swept", "ball|wand", "ball", name="from")
    detections: NamedPaths | None = flag(
        "as `detect` writes them; a wand's have a column marker (0, 1, ...)", "left=CSV,right=CSV"
    )
    lenses: NamedPaths | None = flag("calibrated lenses", "left=CAL,right=CAL", "the recording's")
    scale: str | None = flag(
        "distance of the first two cameras, of a wand's markers 0 and 1, free flight, or the table's corners "
        "(the default with --table-corners)",
        SCALE_FORM,
    )
    table_corners: Path | None = flag(f"camera,corner,u_px,v_px; corners: {', '.join(CORNERS)}", "CSV")
    click_sigma_px: float = setting_flag(RigConfig, "click_sigma_px", "S")
    max_offset_ms: float = setting_flag(RigConfig, "max_offset_ms", "N")
    same_clock: bool = flag("the cameras have one clock: fit no offset")
    physics: Profile = flag("air for gravity", "real|paper", "real")
    detector: MethodArguments
    window_us: PositiveInt | None = flag("length of a window", "N", "the config's")
    out: Path = flag("the calibration of all cameras", "CAL.toml")
    report: Path | None = flag("the reprojection errors as a picture", "FILE.svg")
    json: bool = flag("print the figures as JSON")


def run(arguments: StereoArguments) -> None:
    """Find the point, calibrate, write, and say how good it is."""
    check_destinations(arguments.out, arguments.report, (".toml",))
    scale = read_scale(arguments.scale, arguments.table_corners is not None, arguments.physics)
    config = RigConfig(
        max_offset_ms=0.0 if arguments.same_clock else arguments.max_offset_ms, click_sigma_px=arguments.click_sigma_px
    )
    clicks = read_clicks(arguments.table_corners) if arguments.table_corners is not None else None
    with progress_bar("Calibrating") as progress:
        tracks, lenses = _inputs(arguments, lambda share: progress(DETECTING * share))
        found = calibrate_rig(
            body_tracks(tracks, scale.body_m),
            lenses,
            scale,
            clicks=clicks,
            ball=arguments.swept == "ball",
            config=config,
            progress=lambda share: progress(DETECTING + (1 - DETECTING) * share),
        )
    write_rig(found, arguments.out, arguments.report, as_json=arguments.json)


def read_scale(text: str | None, corners: bool, physics: str) -> Scale:
    """What `--scale` says; the table, if it says nothing and its corners are given."""
    if text is None:
        if not corners:
            raise CommandError("how long is a metre?", expected=f"--scale {SCALE_FORM}, or --table-corners")
        return Scale("table")
    kind, _, length = text.partition("=")
    if kind not in KINDS or (kind in ("baseline", "wand")) != bool(length):
        raise CommandError("no such scale", expected=SCALE_FORM, got=repr(text), where="--scale")
    try:
        length_m = float(length) if length else 0.0
    except ValueError as error:
        raise CommandError("not a length", expected="metres", got=repr(length), where="--scale") from error
    limits = {"baseline": (NEAREST_M, FARTHEST_M), "wand": LIKELY_WAND_M}.get(kind)
    if limits is not None and not limits[0] <= length_m <= limits[1]:
        raise CommandError(
            f"a {kind} of {length_m:g} m cannot be right",
            expected=f"{limits[0]:g} to {limits[1]:g} m",
            where="--scale",
            remedy=re.sub(r", --calibration-unit \w+", "", likely_unit(length_m, limits)),
        )
    if kind == "table" and not corners:
        raise CommandError(
            "the table's corners are not given", remedy="give them with --table-corners", where="--scale"
        )
    return Scale(kind, length_m, REAL_DRAG_PER_M if physics == "real" else 0.0)


def _inputs(
    arguments: StereoArguments, progress: Callable[[float], None]
) -> tuple[dict[str, PointTrack], dict[str, Camera]]:
    """What each camera saw, and its lens."""
    given = {name: read_lens(name, path) for name, path in (arguments.lenses or {}).items()}
    if arguments.detections is not None:
        tracks = {name: read_point_track(path) for name, path in arguments.detections.items()}
        if arguments.recording is not None:
            with closing(open_recording(arguments.recording)) as recording:
                given = {**calibrations_of(recording), **given}
        return tracks, given
    if arguments.swept == "wand":
        raise CommandError("no detector finds a wand's markers", remedy="give their places with --detections")
    if arguments.recording is None:
        raise CommandError("nothing to calibrate from", expected="a recording, or --detections")
    with closing(open_recording(arguments.recording)) as recording:
        tracks = detect_tracks(recording, arguments.detector, arguments.window_us, progress)
        return tracks, {**calibrations_of(recording), **given}


def detect_tracks(
    recording: Recording, method_arguments: MethodArguments, window_us: int | None, progress: Callable[[float], None]
) -> dict[str, PointTrack]:
    """What the detector finds in each camera of a recording."""
    method, config = method_arguments.settings()
    tracks = {}
    for number, (name, stream) in enumerate(recording.cameras.items()):

        def show(share: float, number: int = number) -> None:
            progress((number + share) / len(recording.cameras))

        detector = make_detector(method, stream.sensor, config)
        answers = run_detector(stream, detector, window_us or config.window.window_us, progress=show)
        seen = answers.detected
        tracks[name] = PointTrack.of(answers.t_us[seen], np.column_stack([answers.u_px, answers.v_px])[seen])
    return tracks


def read_lens(name: str, path: Path) -> Camera:
    """The camera of that name in a calibration file, or the only one in it."""
    cameras = noted_calibration(path)
    if len(cameras) > 1 and name not in cameras:
        raise CommandError(f"no camera {name!r}", expected=f"one of {', '.join(cameras)}", where=path)
    return cameras.get(name) or next(iter(cameras.values()))
