"""A robot of one's own in Watch: how it is doing, stop and start."""

from app.modes.watch.robot.panel import RobotPanel

__all__ = ["RobotPanel"]
