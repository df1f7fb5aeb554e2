"""A calibration board as a camera sees it."""

from typing import Final

import numpy as np

from core.cameras.calibration.board import Array, Board, Picture
from core.cameras.camera import Camera
from core.geometry import invert_transform, transform_points

DOT_SHARE: Final = 0.25
"""Radius of a drawn dot, in spacings."""
MARGIN: Final = 1.2
"""White round a drawn pattern, in spacings."""
SUBPIXELS: Final = 3
"""A drawn pixel is the mean of so many by so many points."""


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
