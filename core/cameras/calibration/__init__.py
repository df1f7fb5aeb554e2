"""How a rig is calibrated: lenses from pictures of a board, poses and clocks from a point that was swept through."""

from core.cameras.calibration.board import Board, find_board
from core.cameras.calibration.intrinsics import BoardView, Lens, calibrate_lens

__all__ = ["Board", "BoardView", "Lens", "calibrate_lens", "find_board"]
