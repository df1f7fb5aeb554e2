"""A robot of one's own: how it is doing, and the buttons that stop and start it. It is shared by all browsers."""

from __future__ import annotations

from typing import Final

import viser

from app.modes.in_pool import do_in_pool
from app.modes.mode import ModeHost
from app.modes.watch.robot.words import robot_html
from app.widgets import when_clicked
from core.robot import RobotClient
from core.robot.robot_step_test import RobotStepTest

SHOW_EVERY_S: Final = 0.2
STOP, START, STEP_TEST = "Stop the robot", "Start the robot", "Step test"


class RobotPanel:
    """Status and controls of the robot link in one browser."""

    def __init__(self, gui: viser.GuiApi, robot: RobotClient, step_test: RobotStepTest, host: ModeHost) -> None:
        self._robot, self._step_test, self._host = robot, step_test, host
        self._who = f"a person pressed Stop in browser {host.client.client_id}"
        self._shown_s = float("-inf")
        self._folder = gui.add_folder("Robot (shared by all browsers)")
        with self._folder:
            hint = "At once. Only a person starts it again"
            self._stop = gui.add_button(STOP, icon=viser.Icon.HAND_STOP, color="red", hint=hint)
            hint = "It may move from now on: is everybody out of its reach?"
            self._start = gui.add_button(START, icon=viser.Icon.PLAYER_PLAY, hint=hint)
            hint = "4 cm to the side and back, ten times: how late is it? Targets are sent so much earlier then"
            self._test = gui.add_button(STEP_TEST, icon=viser.Icon.ARROWS_HORIZONTAL, hint=hint, visible=False)
            self._status = gui.add_html("")
        when_clicked(self._stop, self._stop_now)
        when_clicked(self._start, self._ask_to_start)
        when_clicked(self._test, step_test.begin)

    def set_visible(self, visible: bool) -> None:
        """Only while the live rally is watched."""
        self._folder.visible = visible

    def show(self, wall_s: float) -> None:
        """Say how it is doing, some times a second."""
        if wall_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = wall_s
        status, test = self._robot.status, self._step_test.report
        _set_visible(self._start, status.stop is not None)
        _set_visible(self._test, status.ready and not test.running)
        if (said := robot_html(status, test)) != self._status.content:
            self._status.content = said

    def _stop_now(self) -> None:
        """Here and not in the pool, where it would wait behind pictures; it only puts a message into a queue."""
        self._robot.stop(self._who)

    def _ask_to_start(self) -> None:
        do_in_pool(self._host, self._robot.start)


def _set_visible(button: viser.GuiButtonHandle, visible: bool) -> None:
    if button.visible != visible:
        button.visible = visible
