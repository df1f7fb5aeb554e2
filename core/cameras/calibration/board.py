"""A flat board with a regular pattern: where its points are, how they are found in a picture, how it looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from core.cameras.camera import Camera
from core.errors import ConfigError
from core.geometry import invert_transform, transform_points

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

BoardKind = Literal["chessboard", "dots"]
KINDS: Final = get_args(BoardKind)
DOT_SHARE: Final = 0.25
"""Radius of a drawn dot, in spacings."""
MARGIN: Final = 1.2
"""White round a drawn pattern, in spacings."""
SUBPIXELS: Final = 3
"""A drawn pixel is the mean of so many by so many points."""


@dataclass(frozen=True, slots=True)
class Board:
    """`rows` by `columns` points, `spacing_m` apart: the inner corners of a chessboard, or the centres of dots."""

    kind: BoardKind
    rows: int
    columns: int
    spacing_m: float

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ConfigError("no such board", expected=" or ".join(KINDS), got=repr(self.kind))
        if not (3 <= self.rows <= 100 and 3 <= self.columns <= 100):
            remedy = "count the inner corners of a chessboard, or the dots"
            got = f"{self.rows} x {self.columns}"
            raise ConfigError("impossible board", expected="3 to 100 rows and columns", got=got, remedy=remedy)
        if not 1e-4 <= self.spacing_m <= 2.0:
            raise ConfigError("impossible spacing", expected="0.1 to 2000 mm", got=f"{1e3 * self.spacing_m:g} mm")

    @property
    def points_m(self) -> Array:
        """(rows * columns, 3) in the board's frame, row by row; z is 0."""
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        return self.spacing_m * np.column_stack([column, row, np.zeros(len(row))])


def find_board(picture: Picture, board: Board, *, most_blobs: int | None = None) -> Array | None:
    """The pixels (rows * columns, 2) of the board's points in a grey picture, or None if the whole board is not there.

    Black and white are exchanged too: of a blinking board's events either may be the bright one. A picture with more
    than `most_blobs` spots has no dot board: to look for one among thousands takes a minute.
    """
    for candidate in (picture, np.asarray(255 - picture, np.uint8)):
        if board.kind == "chessboard":
            found = _find_corners(candidate, board)
        else:
            found = _find_dots(candidate, board, most_blobs)
        if found is not None:
            return found
    return None


def _find_corners(picture: Picture, board: Board) -> Array | None:
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(picture, (board.columns, board.rows), flags=flags)
    return np.asarray(corners, np.float64).reshape(-1, 2) if found else None


def _find_dots(picture: Picture, board: Board, most_blobs: int | None) -> Array | None:
    settings = cv2.SimpleBlobDetector.Params()
    settings.minArea = 12.0
    settings.maxArea = picture.size / (2.0 * board.rows * board.columns)
    settings.minDistBetweenBlobs = 3.0
    detector = cv2.SimpleBlobDetector.create(settings)
    if most_blobs is not None and len(detector.detect(picture)) > most_blobs:
        return None
    found, centres = cv2.findCirclesGrid(
        picture,
        (board.columns, board.rows),
        flags=cv2.CALIB_CB_SYMMETRIC_GRID,
        blobDetector=detector,
        parameters=cv2.CirclesGridFinderParameters(),
    )
    return np.asarray(centres, np.float64).reshape(-1, 2) if found else None


class BoardPainter:
    """Draws a board as one camera sees it; the rays of its pixels are found once."""

    def __init__(self, camera: Camera) -> None:
        self._shape = camera.sensor.height_px, camera.sensor.width_px
        self._eye_world = camera.position_world_m
        v, u = np.mgrid[: self._shape[0], : self._shape[1]]
        steps = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 0.5
        self._rays_world = [
            camera.unproject(np.column_stack([u.ravel() + right, v.ravel() + down]))
            for down in steps
            for right in steps
        ]

    def draw(self, board: Board, T_world_board: Array) -> Picture:
        """The grey picture (height, width) of a white board with a black pattern, before a grey background."""
        T_board_world = invert_transform(T_world_board)
        eye = transform_points(T_board_world, self._eye_world)
        grey = np.zeros(self._shape[0] * self._shape[1])
        for rays_world in self._rays_world:
            rays = rays_world @ T_board_world[:3, :3].T
            with np.errstate(divide="ignore", invalid="ignore"):
                along = -eye[2] / rays[:, 2]
                at = (eye + along[:, None] * rays)[:, :2] / board.spacing_m
            at[~(along > 0)] = np.nan
            grey += _reflectance(board, at)
        return np.asarray(np.round(grey * 255 / SUBPIXELS**2), np.uint8).reshape(self._shape)


def _reflectance(board: Board, at: Array) -> Array:
    """0 black to 1 white at positions (N, 2) on the board, in spacings from its first point."""
    x, y = at.T
    last_x, last_y = board.columns - 1, board.rows - 1
    reach = MARGIN + (board.kind == "chessboard")
    with np.errstate(invalid="ignore"):
        on_board = (x > -reach) & (x < last_x + reach) & (y > -reach) & (y < last_y + reach)
        if board.kind == "chessboard":
            squares = (x > -1) & (x < last_x + 1) & (y > -1) & (y < last_y + 1)
            black = squares & ((np.floor(x) + np.floor(y)) % 2 == 0)
        else:
            near_x, near_y = np.clip(np.round(x), 0, last_x), np.clip(np.round(y), 0, last_y)
            black = np.hypot(x - near_x, y - near_y) < DOT_SHARE
    return np.where(on_board, np.where(black, 0.05, 0.95), 0.5)
