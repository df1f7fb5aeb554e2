"""Notifications in any mode: a live source, camera or robot is lost or back, or a camera was moved."""

from __future__ import annotations

from typing import Final, NamedTuple

from app.formatting import html_text
from app.shared.live_rally import LiveRally
from core.chain.calibration_drift import DriftReport
from core.live.link.live_source import SourceStatus
from core.live.stream_watch import StreamHealth
from core.robot import RobotStatus

LOOK_EVERY_S: Final = 0.5
STOPPED: Final = "The live source has stopped"
CHANGES: Final = "Changing the scene ..."
SLOW: Final = "The simulation is slow"
HUNG_S: Final = 10.0
"""Silence of a living simulation after which it counts as stopped: a busy machine holds one up for seconds."""
SLOW_AGAIN_S: Final = 60.0
"""A simulation that was slow so short a time ago is not reported again: on a busy machine it often hesitates."""
CALM: Final = {CHANGES, SLOW}
"""Titles that are no problem: they are blue, and their end is not reported."""
BACK: Final = {STOPPED: "The live source is back."}
"""Texts of resolved problems; others have a general one."""


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
        self._slow_s = float("-inf")
        """When the simulation was last slow."""

    def of(self, live: LiveRally | None, wall_s: float) -> list[Notification]:
        """Notifications about changes since the last call."""
        if live is None or wall_s - self._looked_s < LOOK_EVERY_S:
            return []
        self._looked_s = wall_s
        robot = None if live.robot is None else live.robot.status
        changes, lives = live.is_changing_scene, live.simulation_lives
        health = live.watch.health()
        status = live.source.status
        return self.compare(status, health, robot, live.drift, changes_scene=changes, lives=lives, wall_s=wall_s)

    def compare(
        self,
        status: SourceStatus,
        health: StreamHealth,
        robot: RobotStatus | None = None,
        drift: DriftReport | None = None,
        *,
        changes_scene: bool = False,
        lives: bool = False,
        wall_s: float = 0.0,
    ) -> list[Notification]:
        """Notifications about new and resolved problems; each is shown once.

        `changes_scene`: somebody asked the simulation for another scene, so that no data arrives is no problem.
        `lives`: the source is a simulation of this app, whose process has not ended.
        `wall_s`: the time now, s.
        """
        source = {CHANGES: "The simulation builds it; the rally goes on then."} if changes_scene else None
        if source is None and lives and _silent(status, health) and health.quiet_s < HUNG_S:
            source = {SLOW: "This machine is busy. The rally goes on by itself."}
        now = (source or _troubles(status, health)) | _robot_troubles(robot) | _drift_troubles(drift)
        known = self._shown.keys() | ({SLOW} if wall_s - self._slow_s < SLOW_AGAIN_S else set())
        if SLOW in now:
            self._slow_s = wall_s
        begun = [
            Notification(title, body, "blue" if title in CALM else "red")
            for title, body in now.items()
            if title not in known
        ]
        over = [
            Notification("Resolved", BACK.get(title, f"No longer: {title[0].lower()}{title[1:]}."), "green")
            for title in self._shown.keys() - now
            if title not in CALM
        ]
        self._shown = now
        return begun + over


def _silent(status: SourceStatus, health: StreamHealth) -> bool:
    return status == "lost" or health.stopped


def _troubles(status: SourceStatus, health: StreamHealth) -> dict[str, str]:
    """Problems of the source: title -> explanation."""
    if _silent(status, health):
        return {STOPPED: "No data arrives. The last 20 s stay available; see Watch."}
    return {
        f"Camera {one.name} is lost": "No data arrives from it. The rest continues; one camera alone gives no depth."
        for one in health.cameras
        if one.lost
    }


def _robot_troubles(robot: RobotStatus | None) -> dict[str, str]:
    """Problems of an external robot, once it was started."""
    if robot is None:
        return {}
    if robot.connection == "lost":
        return {"The robot is lost": "No data arrives from it, and no targets are sent; see Watch."}
    if robot.stop is not None and robot.stop.by == "robot" and robot.counts.stops:
        return {"The robot has stopped": f"{html_text(robot.stop.reason)}. It can be started again in Watch."}
    return {}


def _drift_troubles(report: DriftReport | None) -> dict[str, str]:
    """Problems of the calibration, without figures: a changing figure would repeat the notification."""
    if report is None or not report.alarm:
        return {}
    body = "A camera or lens was moved. Positions in space are wrong until you calibrate again; see Watch."
    return {"The calibration has drifted": body}
