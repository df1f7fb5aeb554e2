"""The chain from events to a racket: detect in every camera, triangulate, predict, decide.

What needs torch, or a link, is looked up when it is first used.
"""

from typing import TYPE_CHECKING

from core.chain.chain import BallPoint, ChainState, RallyChain
from core.chain.config import ChainConfig
from core.chain.follow import Track, follow_recording, true_positions

if TYPE_CHECKING:
    from core.data_sets.event_windows import EventWindows, collate_windows, count_pictures
    from core.robot import RobotLimits, RobotServer

__all__ = [
    "BallPoint",
    "ChainConfig",
    "ChainState",
    "EventWindows",
    "RallyChain",
    "RobotLimits",
    "RobotServer",
    "Track",
    "collate_windows",
    "count_pictures",
    "follow_recording",
    "true_positions",
]


def __getattr__(name: str) -> object:
    if name in ("EventWindows", "collate_windows", "count_pictures"):
        from core.data_sets import event_windows

        return getattr(event_windows, name)
    if name in ("RobotLimits", "RobotServer"):
        from core.chain import robot

        return getattr(robot, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
