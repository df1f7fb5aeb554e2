"""The example robot with slow motors: its racket is where it was sent to so many seconds ago, and it says so.

python tests/core/robot/late_robot.py SECONDS tcp://127.0.0.1:0
"""

import runpy
import sys
from collections import deque
from pathlib import Path

import numpy as np

import core.robot

LATE_US = round(1e6 * float(sys.argv.pop(1)))
EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "example_robot.py"


class LateServer(core.robot.RobotServer):
    """Told where the motors are sent to, it tells where they are."""

    def __init__(self, *args, **settings) -> None:
        super().__init__(*args, **settings)
        self.path: deque = deque()

    def turn(self, p_m, q_wxyz, v_mps):
        self.path.append((self.now_us(), p_m, q_wxyz, v_mps))
        then_us = self.path[-1][0] - LATE_US
        while len(self.path) > 2 and self.path[1][0] <= then_us:
            self.path.popleft()
        (a_us, *a), (b_us, *b) = self.path[0], self.path[min(1, len(self.path) - 1)]
        share = np.clip((then_us - a_us) / max(1, b_us - a_us), 0, 1)
        p, q, v = ((1 - share) * np.asarray(x) + share * np.asarray(y) for x, y in zip(a, b, strict=True))
        return super().turn(p, q / np.linalg.norm(q), v)


core.robot.RobotServer = LateServer
runpy.run_path(str(EXAMPLE), run_name="__main__")
