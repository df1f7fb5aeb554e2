"""A robot of one's own, as small as it gets: it does what it is told by Rallyscope, here without a motor.

python docs/examples/example_robot.py tcp://127.0.0.1:5600      # then: rallyscope serve ... --robot tcp://127.0.0.1:5600
SIGUSR1 is its red button. docs/how/robot-link.md says what travels.
"""

import signal
import sys
import time

import numpy as np

from core.robot import RobotLimits, RobotServer

HOME, UPRIGHT = np.array([-1.6, 0.0, 0.25]), np.array([1.0, 0.0, 0.0, 0.0])
LIMITS = RobotLimits(
    low_m=(-2.2, -1.0, 0.02),
    high_m=(-1.0, 1.0, 0.9),
    max_speed_mps=5.0,
    max_acceleration_mps2=80.0,
    max_turn_rate_radps=20.0,
)


def advance(p, v, goal, v_goal, left_s, h):
    """After `h` on the way of least squared acceleration to a place and velocity in `left_s` >= h."""
    a = 6 * (goal - p) / left_s**2 - (4 * v + 2 * v_goal) / left_s
    jerk = (-12 * (goal - p) / left_s + 6 * (v + v_goal)) / left_s**2
    return p + v * h + a * h**2 / 2 + jerk * h**3 / 6, v + a * h + jerk * h**2 / 2


def turned(q, goal, share):
    """A part of the way from one orientation to another."""
    q = q + share * ((goal if q @ goal >= 0 else -goal) - q)
    return q / np.linalg.norm(q)


with RobotServer(sys.argv[1] if len(sys.argv) > 1 else "tcp://127.0.0.1:0", LIMITS, name="example") as robot:
    signal.signal(signal.SIGUSR1, lambda *_: robot.stop("the red button was pressed"))
    print(robot.address, flush=True)
    p, v, q, now_us, hit, target = HOME, np.zeros(3), UPRIGHT, robot.now_us(), 0, None
    while True:
        time.sleep(0.002)
        before_us, now_us = now_us, robot.now_us()
        h, still = (now_us - before_us) * 1e-6, np.zeros(3)
        left_s = 0.0 if target is None else (target.impact_us - before_us) * 1e-6
        if robot.stopped:  # brake as hard as it may
            braked = v * max(0.0, 1 - LIMITS.max_acceleration_mps2 * h / max(1e-9, np.linalg.norm(v)))
            p, v = p + (v + braked) * h / 2, braked
        elif target is None:
            p, v = advance(p, v, HOME, still, max(0.4, h), h)
        elif left_s > h:
            p, v = advance(p, v, np.array(target.p_m), np.array(target.v_mps), left_s, h)
            q = turned(q, np.array(target.q_wxyz), h / left_s)
        else:  # the impact, and on for a ball that comes late
            if target.id != hit:
                hit, v, seen_by = target.id, np.array(target.v_mps), " ".join(target.cameras)
                print(f"impact {hit} at {target.impact_us} us, {np.linalg.norm(v):.2f} m/s {seen_by}", flush=True)
            p = p + v * h
        target = robot.turn(p, q, v)  # where it is now: what is told late looks like a late robot
