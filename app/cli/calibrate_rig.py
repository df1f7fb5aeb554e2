"""`rallyscope calibrate rig`: poses, clocks and scale of any number of cameras, from a ball, a wand or a board."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from app.cli.arguments import Names, Numbers, PositiveInt, flag, positional, setting_flag
from app.cli.calibrate_intrinsics import check_destinations
from app.cli.calibrate_stereo import SCALE_FORM, detect_tracks, named_paths, read_lens, read_scale
from app.cli.detector_arguments import MethodArguments
from app.cli.progress import progress_bar
from app.cli.rig_output import write_rig
from core.cameras import Camera
from core.cameras.calibration import Board, find_board
from core.cameras.calibration.board import KINDS, BoardKind
from core.cameras.calibration.body_tracks import BodyTracks, body_tracks, read_points_table
from core.cameras.calibration.point_track import PointTrack, read_point_track
from core.cameras.calibration.rig import RigConfig, calibrate_rig
from core.cameras.calibration.scale import Scale
from core.cameras.calibration.table_corners import CORNERS, read_clicks
from core.errors import CommandError
from core.physics.config import Profile
from core.recordings import calibrations_of, open_recording
from core.recordings.board_pictures import read_board_pictures

DETECTING = 0.6
"""Share of the time that finding the points takes."""
PICTURE_US = 1_000_000
"""Apart are the pictures of a board: nothing moves between them."""
NamedFiles = Annotated[dict[str, Path], named_paths]


@dataclass(frozen=True, slots=True, kw_only=True)
class RigArguments:
    """Poses, clocks and scale of any number of cameras, from a ball, a wand or a board that was moved before them."""

    recording: Path | None = positional("a recording of the sweep; not needed with points, detections or boards", "REC")
    points: Path | None = flag("a table camera,time,x,y[,sigma][,marker]: seconds, pixels, markers 0, 1, ...", "CSV")
    detections: NamedFiles | None = flag("as `detect` writes them; a wand's have a column marker", "a=CSV,b=CSV,...")
    boards: NamedFiles | None = flag("pictures of a board, those taken at once under one name", "a=DIR,b=DIR,...")
    board: BoardKind | None = flag("its pattern", "|".join(KINDS))
    rows: PositiveInt | None = flag("rows of dots, or of inner corners of a chessboard", "R")
    columns: PositiveInt | None = flag("columns, likewise", "C")
    spacing_mm: float | None = flag("from one to the next", "S")
    swept: Literal["ball", "wand"] = flag("what was swept", "ball|wand", "ball", name="from")
    wand: Numbers | None = flag("places of the markers 0, 1, ... along a wand, metres", "0,M,M...")
    lenses: NamedFiles | None = flag("calibrated lenses", "a=CAL,b=CAL,...", "the recording's")
    cameras: Names | None = flag("only these, the first one is the frame", "NAMES", "all")
    refine_lenses: bool = flag("fit focal lengths, principal points, k1 and k2 too")
    scale: str | None = flag(
        "of a ball or a wand's markers 0 and 1: as for `calibrate stereo` (the table with --table-corners)", SCALE_FORM
    )
    table_corners: Path | None = flag(f"camera,corner,u_px,v_px; corners: {', '.join(CORNERS)}", "CSV")
    click_sigma_px: float = setting_flag(RigConfig, "click_sigma_px", "S")
    max_offset_ms: float = setting_flag(RigConfig, "max_offset_ms", "N")
    instants: PositiveInt = setting_flag(RigConfig, "instants", "N")
    same_clock: bool = flag("the cameras have one clock: fit neither offset nor drift")
    physics: Profile = flag("air for gravity", "real|paper", "real")
    detector: MethodArguments
    window_us: PositiveInt | None = flag("length of a window", "N", "the config's")
    out: Path = flag("the calibration of all cameras", "CAL.toml")
    report: Path | None = flag("the reprojection errors as a picture", "FILE.svg")
    json: bool = flag("print the figures as JSON")


def run(arguments: RigArguments) -> None:
    """Collect the points, calibrate, write, and say how good it is."""
    check_destinations(arguments.out, arguments.report, (".toml",))
    # Boards are photographed at rest, which says nothing about clocks.
    still = arguments.same_clock or arguments.boards is not None
    config = RigConfig(
        max_offset_ms=0.0 if still else arguments.max_offset_ms,
        click_sigma_px=arguments.click_sigma_px,
        instants=arguments.instants,
    )
    clicks = read_clicks(arguments.table_corners) if arguments.table_corners is not None else None
    body_m, scale = _body(arguments)
    with progress_bar("Calibrating") as progress:
        seen, sigmas, lenses = _inputs(arguments, lambda share: progress(DETECTING * share))
        names = _names(seen, lenses, arguments.cameras)
        tracks = _tracks(seen, sigmas, names, body_m)
        found = calibrate_rig(
            tracks,
            {name: lenses[name] for name in names},
            scale,
            clicks={name: one for name, one in clicks.items() if name in names} if clicks else None,
            ball=scale is not None and arguments.swept == "ball",
            refine_lenses=arguments.refine_lenses,
            config=config,
            progress=lambda share: progress(DETECTING + (1 - DETECTING) * share),
        )
    write_rig(found, arguments.out, arguments.report, as_json=arguments.json)


def _body(arguments: RigArguments) -> tuple[NDArray[np.float64], Scale | None]:
    """Places (K, 3) of the body's points, m, and the scale of a ball, None for what has a size of its own."""
    if arguments.boards is not None:
        return _board(arguments).points_m, None
    if arguments.wand is not None:
        places = np.array(arguments.wand)
        # Longer than 100 m are millimetres.
        if len(places) < 2 or np.unique(places).size < len(places) or np.ptp(places) > 100:
            raise CommandError("no wand", expected="2 or more places in metres", got=arguments.wand, where="--wand")
        return np.outer(places, [1.0, 0.0, 0.0]), None
    if arguments.swept == "wand" and arguments.scale is None:
        raise CommandError("how long is the wand?", expected="--wand 0,METRES,... or --scale wand=METRES")
    scale = read_scale(arguments.scale, arguments.table_corners is not None, arguments.physics)
    return scale.body_m, None if scale.kind == "wand" else scale


def _board(arguments: RigArguments) -> Board:
    if arguments.board is None or arguments.rows is None or arguments.columns is None or arguments.spacing_mm is None:
        raise CommandError("which board?", expected="--board, --rows, --columns and --spacing-mm")
    return Board(arguments.board, arguments.rows, arguments.columns, arguments.spacing_mm / 1e3)


def _inputs(
    arguments: RigArguments, progress: Callable[[float], None]
) -> tuple[dict[str, PointTrack], dict[str, NDArray[np.float64]], dict[str, Camera]]:
    """What each camera saw, how well it is known where the source says so, and the lenses."""
    sources = (arguments.points, arguments.detections, arguments.boards)
    if sum(source is not None for source in sources) > 1:
        raise CommandError("several sources", expected="one of --points, --detections and --boards")
    lenses: dict[str, Camera] = {}
    sigmas: dict[str, NDArray[np.float64]] = {}
    seen: dict[str, PointTrack] = {}
    found = any(source is not None for source in sources)
    if not found and (arguments.swept == "wand" or arguments.wand is not None):
        raise CommandError("no detector finds a wand's markers", remedy="give their places with --points")
    if arguments.recording is not None:
        with closing(open_recording(arguments.recording)) as recording:
            lenses |= calibrations_of(recording)
            if not found:
                seen = detect_tracks(recording, arguments.detector, arguments.window_us, progress)
    elif not found:
        raise CommandError("nothing to calibrate from", expected="a recording, --points, --detections or --boards")
    if arguments.points is not None:
        seen, sigmas = read_points_table(arguments.points)
    elif arguments.detections is not None:
        seen = {name: read_point_track(path) for name, path in arguments.detections.items()}
    elif arguments.boards is not None:
        seen = _find_boards(arguments.boards, _board(arguments), progress)
    lenses |= {name: read_lens(name, path) for name, path in (arguments.lenses or {}).items()}
    return seen, sigmas, lenses


def _find_boards(folders: Mapping[str, Path], board: Board, progress: Callable[[float], None]) -> dict[str, PointTrack]:
    """The board's points by camera; a picture's name stands for the time."""
    numbers: dict[str, int] = {}
    tracks = {}
    for count, (name, folder) in enumerate(folders.items()):
        t_us, uvs = [], []
        for picture in read_board_pictures(folder, at_most=1000):
            corners = find_board(picture.grey, board)
            progress((count + picture.share) / len(folders))
            if corners is not None:
                t_us.append(PICTURE_US * numbers.setdefault(Path(picture.name).stem, len(numbers)))
                uvs.append(corners)
        size = board.rows * board.columns
        places = np.concatenate(uvs) if uvs else np.zeros((0, 2))
        tracks[name] = PointTrack.of(np.repeat(t_us, size), places, np.tile(np.arange(size), len(t_us)))
    return tracks


def _names(
    seen: Mapping[str, PointTrack], lenses: Mapping[str, Camera], asked: tuple[str, ...] | None
) -> tuple[str, ...]:
    names = asked or tuple(seen)
    for name in names:
        if name not in seen:
            raise CommandError(f"no points of {name}", expected=", ".join(seen) or "points", where="--cameras")
        if name not in lenses:
            remedy = "calibrate it (`rallyscope calibrate intrinsics`) and give the file with --lenses"
            raise CommandError(f"no lens of {name}", expected=", ".join(lenses) or "lenses", remedy=remedy)
    return names


def _tracks(
    seen: Mapping[str, PointTrack],
    sigmas: Mapping[str, NDArray[np.float64]],
    names: tuple[str, ...],
    body_m: NDArray[np.float64],
) -> BodyTracks:
    """The tracks of the body's points in the order of the names; sigmas relative to their median."""
    most = max((int(seen[name].marker.max(initial=0)) for name in names), default=0)
    if most >= len(body_m):
        got = f"markers 0 to {most}, places of {len(body_m)}"
        raise CommandError("where on the wand are the markers?", expected="--wand 0,M,... with one of each", got=got)
    given = {name: sigmas.get(name, np.ones(len(seen[name].t_us))) for name in names}
    middle = float(np.median(np.concatenate(list(given.values())))) if any(map(len, given.values())) else 1.0
    relative = {name: sigma / middle for name, sigma in given.items()}
    return body_tracks({name: seen[name] for name in names}, body_m, relative)
