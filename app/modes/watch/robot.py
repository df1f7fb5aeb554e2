"""Status of the robot, and its stop and start buttons. All browsers share it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import viser

from app import theme
from app.formatting import html_text
from app.modes.mode import ModeHost, do_in_pool
from app.modes.watch.figures import coloured, figures_html, muted
from app.widgets import when_clicked
from core.robot import RobotClient, RobotLimits, RobotStatus
from core.robot.robot_step_test import RobotStepTest, StepTestReport

PARTIES: Final = {"robot": "the robot itself", "rallyscope": "Rallyscope"}


def robot_html(status: RobotStatus, test: StepTestReport) -> str:
    """HTML of the robot's connection, state, position, limits, latency and refused targets."""
    rows = [("Robot", _connection(status)), ("Plays", _plays(status))]
    if status.state is not None and status.connection != "lost":
        rows.append(("Racket", _pose(status)))
    if status.limits is not None:
        rows.append(("Limits", limits_words(status.limits)))
    rows.append(("Late by", _late(test)))
    counts = status.counts
    if counts.sent or counts.kept_back:
        cell = f"{counts.taken:,} taken"
        cell += f", {counts.refused:,} refused by the robot" if counts.refused else ""
        cell += f", {counts.unanswered:,} unanswered" if counts.unanswered else ""
        cell += f", {counts.kept_back:,} held back: too late or outside the limits" if counts.kept_back else ""
        rows.append(("Targets", cell))
    if status.last_refusal:
        rows.append(("Last refusal", muted(html_text(status.last_refusal))))
    troubles = [
        f"{count:,} x {name}"
        for name, count in (("lost", counts.lost), ("slow", counts.slow), ("clock jumped", counts.clock_jumps))
        if count
    ]
    if troubles:
        rows.append(("Until now", muted(", ".join(troubles))))
    return figures_html(rows)


def limits_words(limits: RobotLimits) -> str:
    """Text of the limits: the box, and the speeds in it."""
    box = ", ".join(
        f"{axis} {low:g} to {high:g}" for axis, low, high in zip("xyz", limits.low_m, limits.high_m, strict=True)
    )
    return (
        f"{box} m; {limits.max_speed_mps:g} m/s, {limits.max_acceleration_mps2:g} m/s&sup2;, "
        f"{limits.max_turn_rate_radps:g} rad/s; tilt {math.degrees(limits.max_tilt_rad):.0f}&deg;"
    )


def _connection(status: RobotStatus) -> str:
    where = html_text(status.name or status.address)
    if status.connection != "ready":
        colour = theme.WARN if status.connection in ("awaited", "clock") and not status.counts.lost else theme.BAD
        return coloured(colour, f"{where}: {html_text(status.problem)}. No targets are sent")
    known = "" if status.clock is None else f", its clock known to {status.clock.within_us / 1e3:.1f} ms"
    trip = "" if status.round_trip_ms is None else f", answers in {status.round_trip_ms:.1f} ms"
    return coloured(theme.GOOD, f"{where}, connected{trip}{known}")


def _plays(status: RobotStatus) -> str:
    if status.stop is None and status.connection != "ready":
        return muted("paused; continues when it is back")
    if status.stop is None:
        return coloured(theme.GOOD, "yes: targets are sent")
    cell = f"no, stopped by {PARTIES[status.stop.by]}: {html_text(status.stop.reason)}"
    state = status.state
    if state is not None and state.stopped == "robot" and state.reason != status.stop.reason:
        cell += f". The robot itself: {html_text(state.reason)}"
    return coloured(theme.WARN, cell)


def _late(test: StepTestReport) -> str:
    found = test.found
    if test.running:
        return coloured(theme.WARN, f"measuring, {100 * test.done:.0f} %: it moves to the side and back")
    if found is None:
        cell = "unknown: Step test measures it while no ball flies"
    else:
        mean_ms = round(1e3 * found.mean_s, 1) + 0.0
        cell = f"{mean_ms:.1f} &plusmn; {1e3 * found.sigma_s:.1f} ms, {1e3 * found.jitter_s:.1f} ms from one "
        cell += f"of {found.steps} steps to another" + (": commands are sent this much earlier" if mean_ms > 0 else "")
    cell = coloured(theme.MUTED if found is None else theme.GOOD, cell)
    if test.problem:
        cell += f"<br>{coloured(theme.WARN, f'The last test was aborted: {html_text(test.problem)}')}"
    return cell


def _pose(status: RobotStatus) -> str:
    assert status.state is not None
    x, y, z = status.state.p_m
    speed = float(np.linalg.norm(status.state.v_mps))
    return f"x {x:+.3f}, y {y:+.3f}, z {z:+.3f} m, {speed:.2f} m/s"


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
            hint = "Stops at once. Only a person can start it again"
            self._stop = gui.add_button(STOP, icon=viser.Icon.HAND_STOP, color="red", hint=hint)
            hint = "It will move: is everybody out of its reach?"
            self._start = gui.add_button(START, icon=viser.Icon.PLAYER_PLAY, hint=hint)
            hint = "Moves 4 cm to the side and back, ten times. Targets are then sent earlier by its latency"
            self._test = gui.add_button(STEP_TEST, icon=viser.Icon.ARROWS_HORIZONTAL, hint=hint, visible=False)
            self._status = gui.add_html("")
        when_clicked(self._stop, self._stop_now)
        when_clicked(self._start, self._ask_to_start)
        when_clicked(self._test, step_test.begin)

    def set_visible(self, visible: bool) -> None:
        """Show the controls only while the live rally is watched."""
        self._folder.visible = visible

    def show(self, wall_s: float) -> None:
        """Update the status, a few times a second."""
        if wall_s - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = wall_s
        status, test = self._robot.status, self._step_test.report
        _set_visible(self._start, status.stop is not None)
        _set_visible(self._test, status.ready and not test.running)
        if (cell := robot_html(status, test)) != self._status.content:
            self._status.content = cell

    def _stop_now(self) -> None:
        """Stop at once, not in the thread pool behind pictures; it only puts a message into a queue."""
        self._robot.stop(self._who)

    def _ask_to_start(self) -> None:
        do_in_pool(self._host, self._robot.start)


def _set_visible(button: viser.GuiButtonHandle, visible: bool) -> None:
    if button.visible != visible:
        button.visible = visible
