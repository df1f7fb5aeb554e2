"""Guides for the first calibration: which parts of each picture the ball, or a board, has not been in yet."""

from app.modes.watch.sweep.board_panel import BoardPanel
from app.modes.watch.sweep.panel import SweepPanel

__all__ = ["BoardPanel", "SweepPanel"]
