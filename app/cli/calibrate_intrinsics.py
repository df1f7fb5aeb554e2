"""`rallyscope calibrate intrinsics`: a camera's lens from pictures of a board."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from app.cli.arguments import positive_int
from app.cli.progress import progress_bar
from core.cameras.calibration import Board, BoardView, Lens, calibrate_lens, find_board
from core.cameras.calibration.board import KINDS
from core.cameras.calibration.intrinsics import COEFFICIENTS
from core.cameras.calibration.lens_file import YAML_SUFFIXES, save_lens
from core.cameras.calibration.residual_picture import ResidualPanel, residual_svg
from core.errors import CalibrationError, CommandError
from core.events import SensorSize
from core.recordings.board_pictures import read_board_pictures

SUMMARY = "the lens of one camera, from pictures of a chessboard or a dot board"
POOR_SIGMA = 0.005
"""Relative standard deviation of the focal length above which a warning is printed."""
POOR_COVERAGE = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The sub-verb's arguments."""
    parser.add_argument(
        "source", type=Path, metavar="SRC", help="a folder of pictures, a video, or a recording with frames or events"
    )
    parser.add_argument("--board", required=True, choices=KINDS, metavar="|".join(KINDS), help="the pattern")
    parser.add_argument(
        "--rows",
        type=positive_int,
        required=True,
        metavar="R",
        help="rows of dots, or of inner corners of a chessboard",
    )
    parser.add_argument("--columns", type=positive_int, required=True, metavar="C", help="columns, likewise")
    parser.add_argument("--spacing-mm", type=float, required=True, metavar="S", help="from one to the next")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="CAL", help=".yaml: as OpenCV writes it; .toml: as Rallyscope does"
    )
    parser.add_argument("--camera", metavar="NAME", help="which camera of a recording; its name in the file")
    parser.add_argument(
        "--coefficients",
        type=int,
        default=4,
        choices=COEFFICIENTS,
        metavar="|".join(map(str, COEFFICIENTS)),
        help="how many of k1 k2 p1 p2 k3 are fitted (default: 4; 5 for a wide lens)",
    )
    parser.add_argument(
        "--pictures", type=positive_int, default=40, metavar="N", help="at most so many, evenly spread (%(default)s)"
    )
    parser.add_argument(
        "--window-us", type=positive_int, default=5000, metavar="N", help="of an event picture (%(default)s)"
    )
    parser.add_argument("--report", type=Path, metavar="FILE.svg", help="the residuals as a picture")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Find the board, fit the lens, write it, and say how good it is."""
    board = Board(arguments.board, arguments.rows, arguments.columns, arguments.spacing_mm / 1e3)
    check_destinations(arguments.out, arguments.report)
    views, empty, sensor = _find_views(arguments, board)
    lens = calibrate_lens(views, board, sensor, coefficients=arguments.coefficients)
    name = arguments.camera or "camera"
    save_lens(arguments.out, name, lens.camera, notes={"rms_px": lens.rms_px, "camera_name": name})
    if arguments.report is not None:
        write_lens_report(arguments.report, _picture(lens, f"{name}: {arguments.source.name}"))
    report = _report(lens, empty, arguments)
    print(json.dumps(report) if arguments.json else _describe(lens, empty, arguments.out))


def check_destinations(out: Path, report: Path | None, suffixes: tuple[str, ...] = (*YAML_SUFFIXES, ".toml")) -> None:
    """Raises CommandError before the long work rather than after it."""
    for option, path in (("--out", out), ("--report", report)):
        if path is not None and not path.parent.is_dir():
            raise CommandError("no such folder", got=path.parent, where=option)
    if out.suffix.lower() not in suffixes:
        raise CommandError("not a calibration's name", expected=" or ".join(suffixes), got=out.name, where="--out")
    if report is not None and report.suffix.lower() != ".svg":
        raise CommandError("not a picture's name", expected="FILE.svg", got=report.name, where="--report")


def write_lens_report(path: Path, text: str) -> None:
    """Raises CommandError if it cannot be written."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CommandError(f"cannot write: {error.strerror}", where=path) from error


def _find_views(arguments: argparse.Namespace, board: Board) -> tuple[list[BoardView], list[str], SensorSize]:
    """The pictures with a board, the names of the others, and the size of all."""
    views: list[BoardView] = []
    empty: list[str] = []
    sensor: SensorSize | None = None
    pictures = read_board_pictures(
        arguments.source, camera=arguments.camera, at_most=arguments.pictures, window_us=arguments.window_us
    )
    with progress_bar("Looking for the board") as progress:
        for picture in pictures:
            size = SensorSize(picture.grey.shape[1], picture.grey.shape[0])
            if sensor is not None and size != sensor:
                raise CalibrationError("pictures of several sizes", expected=sensor, got=size, where=picture.name)
            sensor = size
            found = find_board(picture.grey, board)
            if found is None:
                empty.append(picture.name)
            else:
                views.append(BoardView(picture.name, found))
            progress(picture.share)
    if sensor is None or not views:
        raise CalibrationError(
            f"no {board.kind} of {board.rows} x {board.columns} in any of {len(empty)} pictures",
            where=arguments.source,
            remedy="--rows and --columns count the inner corners of a chessboard, the dots of a dot board",
        )
    return views, empty, sensor


def _report(lens: Lens, empty: list[str], arguments: argparse.Namespace) -> dict[str, object]:
    K = lens.camera.K
    values = (K[0, 0], K[1, 1], K[0, 2], K[1, 2], *lens.camera.distortion)
    return {
        "source": str(arguments.source),
        "sensor": str(lens.camera.sensor),
        "rms_px": lens.rms_px,
        "coverage": lens.coverage,
        "parameters": {
            name: {"value": float(value), "sigma": sigma}
            for (name, sigma), value in zip(lens.sigmas.items(), values, strict=True)
        },
        "pictures": [{"name": fit.view.name, "rms_px": fit.rms_px, "used": fit.used} for fit in lens.fits],
        "without_board": empty,
        "out": str(arguments.out),
    }


def _describe(lens: Lens, empty: list[str], out: Path) -> str:
    K, d, sigma = lens.camera.K, lens.camera.distortion, lens.sigmas
    rms = np.array([fit.rms_px for fit in lens.fits if fit.used])
    lines = [
        f"{out}: {len(rms)} pictures, rms {lens.rms_px:.3f} px (of a picture: {rms.min():.3f} to {rms.max():.3f}), "
        f"points in {100 * lens.coverage:.0f} % of the picture's cells",
        f"fx {K[0, 0]:.2f} +- {sigma['fx']:.2f}, fy {K[1, 1]:.2f} +- {sigma['fy']:.2f}, "
        f"cx {K[0, 2]:.2f} +- {sigma['cx']:.2f}, cy {K[1, 2]:.2f} +- {sigma['cy']:.2f} px",
        ", ".join(
            f"{name} {value:.5f} +- {sigma[name]:.5f}"
            for name, value in zip(("k1", "k2", "p1", "p2", "k3"), d, strict=True)
            if sigma[name] > 0
        ),
    ]
    lines += [f"left out: {fit.view.name}, rms {fit.rms_px:.2f} px" for fit in lens.fits if not fit.used]
    if empty:
        more = "" if len(empty) <= 5 else f" and {len(empty) - 5} more"
        lines.append(f"no whole board in {len(empty)} pictures: {', '.join(empty[:5])}{more}")
    if sigma["fx"] > POOR_SIGMA * K[0, 0]:
        lines.append("the focal length is poorly known: tilt the board more, by 20 to 40 degrees about both axes")
    if lens.coverage < POOR_COVERAGE:
        lines.append("much of the picture was never covered: hold the board into its corners too")
    return "\n".join(line for line in lines if line)


def _picture(lens: Lens, title: str) -> str:
    uvs = np.concatenate([fit.view.uvs_px for fit in lens.fits])
    residuals = np.concatenate([fit.residuals_px for fit in lens.fits])
    used = np.concatenate([np.full(len(fit.residuals_px), fit.used) for fit in lens.fits])
    return residual_svg(title, [ResidualPanel("lens", lens.camera.sensor, uvs, residuals, used)])
