"""An external robot on the documented link: targets within limits, its state, stops."""

from core.robot.latency_test import measure_robot
from core.robot.robot_client import RobotClient
from core.robot.robot_messages import RobotLimits, RobotState, RobotTarget
from core.robot.robot_server import RobotServer
from core.robot.robot_watch import RobotStatus, RobotWatchConfig
from core.robot.source_with_robot import SourceWithRobot

__all__ = [
    "RobotClient",
    "RobotLimits",
    "RobotServer",
    "RobotState",
    "RobotStatus",
    "RobotTarget",
    "RobotWatchConfig",
    "SourceWithRobot",
    "measure_robot",
]
