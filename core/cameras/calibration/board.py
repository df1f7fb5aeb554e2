"""A flat board with a regular pattern: where its points are, and how they are found in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from core.cameras.camera import Camera
from core.errors import ConfigError

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

BoardKind = Literal["chessboard", "dots"]
KINDS: Final = get_args(BoardKind)


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
            metres = 1e-4 <= 1e3 * self.spacing_m <= 1.0
            remedy = f"{1e3 * self.spacing_m:g} m are {1e6 * self.spacing_m:g} mm" if metres else None
            got = f"{1e3 * self.spacing_m:g} mm"
            raise ConfigError("impossible spacing", expected="0.1 to 2000 mm", got=got, remedy=remedy)

    @property
    def points_m(self) -> Array:
        """(rows * columns, 3) in the board's frame, row by row; z is 0."""
        row, column = np.divmod(np.arange(self.rows * self.columns), self.columns)
        return self.spacing_m * np.column_stack([column, row, np.zeros(len(row))])


def board_pose(board: Board, uvs_px: Array, camera: Camera) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) from the board to the camera that explain its points (N, 2) best."""
    if camera.model == "fisheye":
        uvs, K, coefficients = camera.undistort(uvs_px), np.eye(3), np.zeros(5)
    else:
        uvs, K, coefficients = uvs_px, camera.K, camera.distortion
    seen = np.isfinite(uvs[:, 0])
    _, rvec, tvec = cv2.solvePnP(board.points_m[seen], uvs[seen], K, coefficients)
    return np.asarray(cv2.Rodrigues(rvec)[0], np.float64), np.ravel(tvec).astype(np.float64)


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
