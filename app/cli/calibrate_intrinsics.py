"""`rallyscope calibrate intrinsics`: a camera's lens from pictures of a board."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.cli.arguments import PositiveInt, flag, positional
from app.cli.files import check_folder, write_text
from app.cli.progress import progress_bar
from app.cli.terminal import say
from core.cameras.calibration import Board, BoardView, Lens, calibrate_lens, find_board
from core.cameras.calibration.board import KINDS, BoardKind
from core.cameras.calibration.coverage import (
    CELLS_ACROSS,
    CELLS_DOWN,
    BoardCover,
    board_cover,
    cover_column,
    missing_for_lens,
    odd_spacing,
)
from core.cameras.calibration.intrinsics import COEFFICIENTS, YAML_SUFFIXES, save_lens
from core.cameras.calibration.residual_picture import ResidualPanel, residual_svg
from core.cameras.distortion import LensModel
from core.errors import CalibrationError, CommandError, ConfigError
from core.events import SensorSize
from core.recordings.board_pictures import read_board_pictures
from core.text import counted

DEFAULT_COEFFICIENTS = 4
POOR_SIGMA = 0.005
"""Relative standard deviation of the focal length above which a warning is printed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IntrinsicsArguments:
    """The lens of one camera, from pictures of a chessboard or a dot board."""

    source: Path = positional("a folder of pictures, a video, or a recording with frames or events", "SRC")
    board: BoardKind = flag("the pattern", "|".join(KINDS))
    rows: PositiveInt = flag("rows of dots, or of inner corners of a chessboard", "R")
    columns: PositiveInt = flag("columns, likewise", "C")
    spacing_mm: float = flag("from one to the next", "S")
    out: Path = flag(".yaml: as OpenCV writes it; .toml: as Rallyscope does", "CAL")
    camera: str | None = flag("which camera of a recording; its name in the file", "NAME")
    model: LensModel = flag("fisheye: Kannala-Brandt, for lenses beyond about 100 degrees", default="pinhole")
    coefficients: int | None = flag(
        "how many of a pinhole's k1 k2 p1 p2 k3 are fitted, 5 for a wide lens",
        "|".join(map(str, COEFFICIENTS)),
        DEFAULT_COEFFICIENTS,
        choices=COEFFICIENTS,
    )
    pictures: PositiveInt = flag("at most so many, evenly spread", "N", 40)
    window_us: PositiveInt = flag("of an event picture", "N", 5000)
    report: Path | None = flag("the residuals, and where the board was, as a picture", "FILE.svg")
    json: bool = flag("print the figures as JSON")


def run(arguments: IntrinsicsArguments) -> None:
    """Find the board, fit the lens, write it, and say how good it is."""
    board = _board(arguments)
    if arguments.model == "fisheye" and arguments.coefficients is not None:
        raise CommandError("a fisheye lens has four coefficients", where="--coefficients", remedy="leave it out")
    check_destinations(arguments.out, arguments.report)
    views, empty, sensor = _find_views(arguments, board)
    lens = calibrate_lens(views, board, sensor, coefficients=_coefficients(arguments), model=arguments.model)
    name = arguments.camera or "camera"
    save_lens(arguments.out, name, lens.camera, notes={"rms_px": lens.rms_px, "camera_name": name})
    cover = board_cover([fit.view for fit in lens.fits if fit.used], board, lens.camera)
    if arguments.report is not None:
        write_text(arguments.report, _picture(lens, cover, f"{name}: {arguments.source.name}"))
    report = _report(lens, cover, empty, arguments)
    say(json.dumps(report) if arguments.json else _describe(lens, cover, empty, arguments.out))


def _coefficients(arguments: IntrinsicsArguments) -> int:
    return DEFAULT_COEFFICIENTS if arguments.coefficients is None else arguments.coefficients


def _board(arguments: IntrinsicsArguments) -> Board:
    try:
        return Board(arguments.board, arguments.rows, arguments.columns, arguments.spacing_mm / 1e3)
    except ConfigError as error:
        where = "--spacing-mm" if "spacing" in error.what else "--rows, --columns"
        raise CommandError(str(error), where=where) from error


def check_destinations(out: Path, report: Path | None, suffixes: tuple[str, ...] = (*YAML_SUFFIXES, ".toml")) -> None:
    """Raises CommandError before the long work rather than after it."""
    check_folder(out)
    check_folder(report, "--report")
    if out.suffix.lower() not in suffixes:
        raise CommandError("not a calibration's name", expected=" or ".join(suffixes), got=out.name, where="--out")
    if report is not None and report.suffix.lower() != ".svg":
        raise CommandError("not a picture's name", expected="FILE.svg", got=report.name, where="--report")


def _find_views(arguments: IntrinsicsArguments, board: Board) -> tuple[list[BoardView], list[str], SensorSize]:
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
            # A calibration is for one picture size.
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
            f"no {board.kind} of {board.rows} x {board.columns} in any of {counted(len(empty), 'picture')}",
            where=arguments.source,
            remedy="--rows and --columns count the inner corners of a chessboard, the dots of a dot board",
        )
    return views, empty, sensor


def _report(lens: Lens, cover: BoardCover, empty: list[str], arguments: IntrinsicsArguments) -> dict[str, object]:
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
        "cover": {
            "cells": cover.cells.reshape(CELLS_DOWN, CELLS_ACROSS).tolist(),
            "tilts_deg": cover.tilts_deg.round(1).tolist(),
            "distances_m": cover.distances_m.round(4).tolist(),
            "missing": list(missing_for_lens(cover)),
        },
        "notes": [note for note in (odd_spacing(cover),) if note is not None],
        "out": str(arguments.out),
    }


def _describe(lens: Lens, cover: BoardCover, empty: list[str], out: Path) -> str:
    K, d, sigma = lens.camera.K, lens.camera.distortion, lens.sigmas
    rms = np.array([fit.rms_px for fit in lens.fits if fit.used])
    lines = [
        f"{out}: {counted(len(rms), 'picture')}, rms {lens.rms_px:.3f} px (of a picture: "
        f"{rms.min():.3f} to {rms.max():.3f}), points in {100 * lens.coverage:.0f} % of the picture's cells",
        f"fx {K[0, 0]:.2f} +- {sigma['fx']:.2f}, fy {K[1, 1]:.2f} +- {sigma['fy']:.2f}, "
        f"cx {K[0, 2]:.2f} +- {sigma['cx']:.2f}, cy {K[1, 2]:.2f} +- {sigma['cy']:.2f} px",
        ", ".join(
            f"{name} {value:.5f} +- {sigma[name]:.5f}"
            for name, value in zip(list(sigma)[4:], d, strict=True)
            if sigma[name] > 0
        ),
    ]
    lines += [f"left out: {fit.view.name}, rms {fit.rms_px:.2f} px" for fit in lens.fits if not fit.used]
    if empty:
        more = "" if len(empty) <= 5 else f" and {len(empty) - 5} more"
        lines.append(f"no whole board in {counted(len(empty), 'picture')}: {', '.join(empty[:5])}{more}")
    if sigma["fx"] > POOR_SIGMA * K[0, 0]:
        lines.append("the focal length is poorly known: tilt the board more, by 20 to 40 degrees about both axes")
    lines += [odd_spacing(cover) or "", *_cover_lines(cover)]
    return "\n".join(line for line in lines if line)


def _cover_lines(cover: BoardCover) -> list[str]:
    """Where the board was, and what to show more."""
    (left, upper), (right, lower) = -cover.tilts_deg.min(axis=0), cover.tilts_deg.max(axis=0)
    missing = missing_for_lens(cover)
    text = (
        f"missing: {'; '.join(missing)}" if missing else "nothing is missing: all parts, tilts and distances were seen"
    )
    return [
        f"the board was in {int((cover.cells > 0).sum())} of {len(cover.cells)} parts of the picture, tilted by "
        f"{-left:+.0f} to {right:+.0f} degrees about the vertical axis and {-upper:+.0f} to {lower:+.0f} about the "
        f"horizontal one, {cover.distances_m.min():.2f} to {cover.distances_m.max():.2f} m away",
        text,
    ]


def _picture(lens: Lens, cover: BoardCover, title: str) -> str:
    uvs = np.concatenate([fit.view.uvs_px for fit in lens.fits])
    residuals = np.concatenate([fit.residuals_px for fit in lens.fits])
    used = np.concatenate([np.full(len(fit.residuals_px), fit.used) for fit in lens.fits])
    panel = ResidualPanel("lens", lens.camera.sensor, uvs, residuals, used)
    return residual_svg(title, [panel], [cover_column(cover, lens.camera.sensor)])
