"""A guide for the first calibration: which parts of each picture the ball has not been in yet."""

from app.modes.watch.sweep.panel import SweepPanel

__all__ = ["SweepPanel"]
