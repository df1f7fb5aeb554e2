"""Step test of an external robot: the latency of its racket.

The racket goes some centimetres to the side and back, from rest to rest. When it heard of a step, when it was to be
there and when it was where are all times of the robot's own clock, so the way of the messages is not in the figure. A
robot that begins late and hurries to be there in time is found to be half as late as it begins.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.control.step_test import CommandLatency, RacketStep, command_latency
from core.errors import TargetRefusedError
from core.robot.robot_client import RobotClient, host_us
from core.robot.robot_messages import RobotLimits, RobotState

Array = NDArray[np.float64]

STEPS: Final = 10
STEP_M: Final = 0.04
"""Length of a step to the side: halfway it moves at 0.24 m/s, so 0.2 mm are 1 ms."""
TAKES_S: Final = 0.25
LONGEST_S: Final = 1.5
"""Longest step, for slow robots; one that takes longer is not measured."""
SHARE_OF_LIMITS: Final = 0.5
"""Share of the robot's limits of speed and acceleration that is used."""
LATEST_S: Final = 0.25
"""Longest wait after the arrival time."""
REST_S: Final = 0.1
REST_M: Final = 0.0003
"""The robot is at rest when its positions of the last REST_S differ by less than this."""
REST_WITHIN_S: Final = 5.0
REACHED: Final = 0.8
"""Share of the way that has to be reached; a robot that stops short of it did not follow the command."""
LONGEST_GAP_S: Final = 0.025
"""Longest gap between states during a step; the step is repeated after a longer one."""
TRIES: Final = 4
"""Most attempts, as a multiple of the steps."""
FIRST_TRIES: Final = 5
"""Failed first attempts after which the test ends."""
LOOK_EVERY_S: Final = 0.005


def measure_robot(
    robot: RobotClient,
    refuse: Callable[[], str] = lambda: "",
    progress: Callable[[float], None] = lambda share: None,
    steps: int = STEPS,
) -> CommandLatency:
    """Send the racket `steps` times to the side and back, through the same check as every target.

    `refuse` is asked all the time, and what it answers, if anything, is why the test must not go on. `progress` hears
    the share that is done. Takes some two seconds a step.

    Raises:
        TargetRefusedError: if a step does not leave, the robot does not take it, it is stopped, or `refuse` says so.
        NoAnswerError: if it does not answer.
        ConfigError: if it does not move as it is told.
    """
    found: list[RacketStep] = []
    never_there = 0
    base = _rest(robot, refuse)
    aside = _aside(_limits(robot), base)
    for _ in range(TRIES * steps):
        start = _rest(robot, refuse)
        # To the farther of the two, wherever the racket came to rest.
        goal = max(base, base + aside, key=lambda p: float(np.linalg.norm(p - start)))
        step = _step(robot, refuse, start, goal)
        never_there += math.isnan(step.late_s)
        if math.isfinite(step.late_s) and _longest_gap_s(step) <= LONGEST_GAP_S:
            found.append(step)
            progress(len(found) / steps)
        if len(found) == steps or (not found and never_there == FIRST_TRIES):
            return command_latency(found)
    raise _broken_off("lost", f"only {len(found)} of {TRIES * steps} steps were seen whole: its states come too seldom")


def _longest_gap_s(step: RacketStep) -> float:
    """Longest gap without a state during the motion, s."""
    moves = (step.t_s > step.sent_s) & (step.t_s < step.due_s + max(0.0, step.late_s))
    return float(np.diff(step.t_s[moves]).max(initial=0.0)) if moves.sum() > 1 else math.inf


def _step(robot: RobotClient, refuse: Callable[[], str], start: Array, goal: Array) -> RacketStep:
    takes_s = _takes_s(_limits(robot), float(np.linalg.norm(goal - start)))
    state, clock = _state(robot, refuse), robot.status.clock
    if clock is None:
        raise _broken_off("lost", "its clock is not known")
    due_us = host_us() + 1e6 * takes_s
    answer = robot.aim(goal, state.q_wxyz, np.zeros(3), due_us)
    sent_s, due_s = 1e-6 * answer.t_us, 1e-6 * clock.robot_us(due_us)
    while (now := _state(robot, refuse)).t_us * 1e-6 < due_s + LATEST_S:
        if host_us() > due_us + 1e6 * (LATEST_S + 1):
            raise _broken_off("lost", f"it told nothing of {1e3 * LATEST_S:.0f} ms after a step ({now.t_us} us)")
        time.sleep(LOOK_EVERY_S)
    states = robot.states_since(answer.t_us - 50_000)
    t_s, ps = np.array([1e-6 * one.t_us for one in states]), np.array([one.p_m for one in states])
    way = goal - start
    reached = float(((ps - start) @ way).max() / (way @ way))
    there = goal if reached < REACHED else start + reached * way
    return RacketStep(sent_s, due_s, start, there, t_s, ps)


def _rest(robot: RobotClient, refuse: Callable[[], str]) -> Array:
    """(3,) where it has come to rest."""
    until_s = time.monotonic() + REST_WITHIN_S
    while True:
        now = _state(robot, refuse)
        states = robot.states_since(round(now.t_us - 1e6 * REST_S))
        ps = np.array([one.p_m for one in states])
        whole = len(states) > 5 and 1e-6 * (now.t_us - states[0].t_us) > 0.8 * REST_S
        if whole and float(np.ptp(ps, axis=0).max()) < REST_M:
            return np.asarray(ps.mean(axis=0), np.float64)
        if time.monotonic() > until_s:
            raise _broken_off("unreachable", f"it does not come to rest within {REST_WITHIN_S:g} s")
        time.sleep(LOOK_EVERY_S)


def _state(robot: RobotClient, refuse: Callable[[], str]) -> RobotState:
    """The robot's newest state, if the test may go on."""
    status = robot.status
    if status.stop is not None:
        raise _broken_off("stopped", f"stopped by {status.stop.by}: {status.stop.reason}")
    if status.connection != "ready" or status.state is None:
        raise _broken_off("lost", status.problem)
    why = refuse()
    if why:
        raise _broken_off("stopped", why)
    return status.state


def _limits(robot: RobotClient) -> RobotLimits:
    limits = robot.status.limits
    if limits is None:
        raise _broken_off("lost", "it has not told its limits")
    return limits


def _aside(limits: RobotLimits, base: Array) -> Array:
    """(3,) a step to the side, or, where the box is too narrow, up or along the table."""
    low, high = np.array(limits.low_m), np.array(limits.high_m)
    for axis in (1, 2, 0):
        for sign in (1.0, -1.0):
            step = np.zeros(3)
            step[axis] = sign * STEP_M
            if ((base + step >= low) & (base + step <= high)).all():
                return step
    raise _broken_off("bounds", f"its box leaves no room for a step of {100 * STEP_M:g} cm")


def _takes_s(limits: RobotLimits, length_m: float) -> float:
    """Time of a cubic move of this length that stays within `SHARE_OF_LIMITS`, s."""
    speed, force = SHARE_OF_LIMITS * limits.max_speed_mps, SHARE_OF_LIMITS * limits.max_acceleration_mps2
    takes_s = max(TAKES_S, 1.5 * length_m / speed, math.sqrt(6 * length_m / force))
    if takes_s > LONGEST_S:
        raise _broken_off("bounds", f"by its limits a step of {100 * length_m:.0f} cm takes {takes_s:.1f} s")
    return takes_s


def _broken_off(why: str, text: str) -> TargetRefusedError:
    return TargetRefusedError(why, text, where="step test")
