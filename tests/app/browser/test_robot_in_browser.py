"""A robot of one's own in headless Chromium: started and stopped by a person, lost, and back."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from app.server import App
from app.shared.library import Library
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from core.robot import RobotClient, RobotServer, RobotWatchConfig
from tests.core.robot.limits import LIMITS
from tests.waiting import eventually

PATIENT = RobotWatchConfig(lost_ms=10_000.0, slow_ms=5_000.0)
"""A machine that does other things is not taken for a lost robot."""


class JumpingArm:
    """A robot on a thread that is where it is sent at once."""

    def __init__(self) -> None:
        self.server = RobotServer("tcp://127.0.0.1:0", LIMITS, name="<b>arm")
        self.hangs, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        p = np.array([-1.6, 0.0, 0.25])
        while not self._ended.wait(0.003):
            if not self.hangs.is_set():
                target = self.server.turn(p, (1.0, 0.0, 0.0, 0.0), np.zeros(3))
                p = p if target is None else np.array(target.p_m)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.server.close()


@pytest.fixture
def arm() -> Iterator[JumpingArm]:
    arm = JumpingArm()
    yield arm
    arm.close()


@pytest.fixture
def robot_lab(tmp_path, arm, serve_recording) -> Iterator[App]:
    workspace = Workspace(tmp_path)
    robot = RobotClient(arm.server.address, config=PATIENT)
    live = LiveRally(ReplaySource(open_recording(serve_recording), "serve.h5"), robot=robot)
    lab = App(workspace, Library(workspace), LIVE, host="127.0.0.1", port=0, live=live)
    yield lab
    lab.stop()


def test_a_robot_is_started_stopped_lost_and_back(chromium, robot_lab, arm, open_window) -> None:
    rally = robot_lab.services.rallies.live
    assert rally is not None and rally.robot is not None and rally.has_robot
    robot = rally.robot
    with open_window(robot_lab, in_space=True) as window:
        page = window.page
        page.get_by_text("<b>arm, connected").wait_for()
        page.get_by_text("stopped by Rallyscope: not started yet").wait_for()
        page.get_by_text("x -2.2 to -1, y -1 to 1, z 0.02 to 0.9 m").wait_for()
        assert not page.get_by_text("There is no robot").count() and robot.status.counts.sent == 0
        window.press("Start the robot")
        page.get_by_text("yes: targets are sent").wait_for()
        eventually(lambda: robot.status.counts.taken, "a target that it takes")
        racket = lambda: rally.history.at(rally.history.followed_us, {}).picture.racket  # noqa: E731
        eventually(lambda: racket() is not None, "its racket to stand in the scene")
        page.get_by_text("Racket turned by").first.wait_for()
        sent = robot.status.counts.sent
        window.press("Step test")
        page.get_by_text("The last test was aborted: a ball flies").wait_for()
        assert rally.player.latency is None
        eventually(lambda: robot.status.counts.sent > sent, "it to go on playing")
        window.screenshot("robot-plays")

        window.press("Stop the robot")
        page.get_by_text("a person pressed Stop in browser").wait_for()
        eventually(lambda: "a person pressed Stop" in arm.server.stopped, "the robot to know")
        sent = robot.status.counts.sent
        window.press("Start the robot")
        eventually(lambda: robot.status.counts.sent > sent, "it to play again")

        robot._watch.config = RobotWatchConfig(lost_ms=1000.0, slow_ms=PATIENT.slow_ms)
        arm.hangs.set()
        page.get_by_text("The robot is lost").wait_for()
        page.get_by_text("No targets are sent").first.wait_for()
        window.screenshot("robot-lost")
        arm.hangs.clear()
        page.get_by_text("<b>arm, connected").wait_for()
    assert robot.status.counts.lost >= 1
