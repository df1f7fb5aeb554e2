"""What a browser is told in any mode: a live source, camera or robot is lost or comes back, a camera was moved."""

from __future__ import annotations

from typing import Final, NamedTuple

from app.formatting.text import html_text
from app.shared.live_rally import LiveRally
from core.chain.calibration_drift import DriftReport
from core.live.link.live_source import SourceStatus
from core.live.stream_watch import StreamHealth
from core.robot import RobotStatus

LOOK_EVERY_S: Final = 0.5
STOPPED: Final = "The live source has stopped"


class Notification(NamedTuple):
    """A message that goes away by itself."""

    title: str
    body: str
    color: str


class SourceNotifications:
    """Notifications about the live source for one browser. Called by its loop."""

    def __init__(self) -> None:
        self._looked_s = float("-inf")
        self._shown: dict[str, str] = {}

    def of(self, live: LiveRally | None, wall_s: float) -> list[Notification]:
        """What has changed since the last look."""
        if live is None or wall_s - self._looked_s < LOOK_EVERY_S:
            return []
        self._looked_s = wall_s
        robot = None if live.robot is None else live.robot.status
        return self.compare(live.source.status, live.watch.health(), robot, live.drift)

    def compare(
        self,
        status: SourceStatus,
        health: StreamHealth,
        robot: RobotStatus | None = None,
        drift: DriftReport | None = None,
    ) -> list[Notification]:
        """What is wrong and was not before, and what no longer is; each is told once."""
        now = _troubles(status, health) | _robot_troubles(robot) | _drift_troubles(drift)
        begun = [Notification(title, body, "red") for title, body in now.items() if title not in self._shown]
        over = [
            Notification("It goes on", f"Over: {title[0].lower()}{title[1:]}.", "green")
            for title in self._shown.keys() - now
        ]
        self._shown = now
        return begun + over


def _troubles(status: SourceStatus, health: StreamHealth) -> dict[str, str]:
    """Title -> what it means."""
    if status == "lost" or health.stopped:
        return {STOPPED: "Nothing comes any more. What is remembered stays; Watch says more."}
    return {
        f"Camera {one.name} is lost": "Nothing comes of it. The rest goes on; one camera alone sees no depth."
        for one in health.cameras
        if one.lost
    }


def _robot_troubles(robot: RobotStatus | None) -> dict[str, str]:
    """Problems of an external robot, once it was started."""
    if robot is None:
        return {}
    if robot.connection == "lost":
        return {"The robot is lost": "Nothing is heard of it, and nothing is sent to it. Watch says more."}
    if robot.stop is not None and robot.stop.by == "robot" and robot.counts.stops:
        return {"The robot has stopped": f"{html_text(robot.stop.reason)}. In Watch a person can start it again."}
    return {}


def _drift_troubles(report: DriftReport | None) -> dict[str, str]:
    """Problems of the calibration, without figures: a changing figure would repeat the notification."""
    if report is None or not report.alarm:
        return {}
    body = (
        "One was moved, or its lens. Positions in space are wrong until they are calibrated again; Watch says how far."
    )
    return {"The cameras no longer fit each other": body}
