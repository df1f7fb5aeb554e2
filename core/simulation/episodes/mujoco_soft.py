"""Soft MuJoCo contacts: the second, rougher physics, to try on it what was learned with rigid impacts.

Restitution and friction are those of the config on the average; a single landing scatters by several centimetres with
the phase of the time step, so this is a test of transfer and not a physics to train or to measure in.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import ConfigError
from core.physics.episode import Outcomes, Serves, Strokes
from core.physics.rotation import normals_from_orientations
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import fly_serves, follow_hits
from core.simulation.episodes.mujoco_model import build_model, mj
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]

SOFT_STEP_S = 0.0005
LONGEST_S = 3.0


class SoftTable:
    """The MuJoCo model with its own contacts; the racket is a heavy free body that coasts (a mocap body has no velocity
    for the contact solver).
    """

    def __init__(self, task: TaskConfig, *, dt_s: float = SOFT_STEP_S) -> None:
        if not 1e-5 <= dt_s <= 0.002:
            raise ConfigError(
                "soft contacts need a short step", expected="0.00001 to 0.002 s", got=dt_s, where="SoftTable"
            )
        if task.physics.rubber.tangential_restitution or task.physics.rubber.spin_retention < 1:
            raise ConfigError(
                "soft contacts cannot throw back tangential speed or take spin about the normal",
                expected="tangential_restitution 0 and spin_retention 1",
                where="SoftTable",
                remedy="use the paper profile",
            )
        self.model = build_model(task.physics, dt_s=dt_s, soft=True)
        self.data = mj.MjData(self.model)
        self._ball = self.model.geom("ball").id

    def place(self, ball: Array, racket_p: ArrayLike, racket_q: ArrayLike, racket_v: ArrayLike) -> None:
        """Start from a ball state (9,) and a racket pose and velocity."""
        mj.mj_resetData(self.model, self.data)
        self.data.qpos[:3] = ball[:3]
        self.data.qvel[:6] = ball[3:9]  # at the identity orientation body and world agree
        self.data.qpos[7:10] = racket_p
        self.data.qpos[10:14] = racket_q
        self.data.qvel[6:9] = racket_v

    def ball(self) -> Array:
        """(9,) the ball's state in the world."""
        state = np.empty(9)
        state[:3] = self.data.qpos[:3]
        state[3:6] = self.data.qvel[:3]
        mj.mju_rotVecQuat(state[6:9], self.data.qvel[3:6], self.data.qpos[3:7])
        return state

    def step(self) -> set[str]:
        """One time step; the names of the geoms that the ball touches."""
        mj.mj_step(self.model, self.data)
        touched: set[str] = set()
        for k in range(self.data.ncon):
            first, second = self.data.contact.geom[k]
            touched.add(self.model.geom(int(second if first == self._ball else first)).name)
        return touched

    def run_through(self, name: str) -> float | None:
        """Step until the ball has touched geom `name` and left it; the time, or None if it touches another first."""
        touching = False
        while self.data.time < LONGEST_S:
            touched = self.step()
            if name in touched:
                touching = True
            elif touching:
                return float(self.data.time)
            elif touched:
                return None
        return None


def drop_on(soft: SoftTable, surface: Literal["table", "racket"], velocity_mps: ArrayLike, gap_m: float) -> Array:
    """Velocity and spin (6,) of a spinless ball after an impact with `velocity_mps` (3,).

    Both have their first component along the surface's outward normal, so the velocity's is negative. The gap decides
    where in a time step the impact begins. Gravity is left out.
    """
    gravity = soft.model.opt.gravity.copy()
    soft.model.opt.gravity[:] = 0
    # Rotations that take the surface's outward normal from x to the world.
    axes = np.eye(3) if surface == "racket" else np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    start = np.array([-0.7, 0.0, 1.0 if surface == "racket" else 0.0])
    away = np.array([50.0, 0.0, 1.0])
    state = np.zeros(9)
    state[:3] = start + axes @ np.array([BALL_RADIUS_M + gap_m, 0, 0])
    state[3:6] = axes @ np.asarray(velocity_mps, np.float64)
    soft.place(state, start if surface == "racket" else away, (1, 0, 0, 0), (0, 0, 0))
    left = soft.run_through(surface)
    soft.model.opt.gravity[:] = gravity
    assert left is not None, "a ball that flies at a surface touches it"
    after = soft.ball()
    return np.concatenate([axes.T @ after[3:6], axes.T @ after[6:9]])


def simulate_episodes_soft(
    serves: Serves, strokes: Strokes, config: TaskConfig, *, dt_s: float = SOFT_STEP_S
) -> Outcomes:
    """What `simulate_episodes` gives, with both impacts soft; after the racket the flight is the closed form's."""
    aim_p, aim_t = strokes.aim_ps_m, strokes.aim_t_s
    if aim_p is None or aim_t is None:
        arrivals = fly_serves(serves, config)
        aim_p, aim_t = arrivals.states[:, :3], arrivals.t_s
    normals = normals_from_orientations(strokes.qs_wxyz)
    soft = SoftTable(config, dt_s=dt_s)
    n = len(serves)
    hit_t, hits = np.full(n, np.nan), np.full((n, 9), np.nan)
    starts = serves.states()
    for i in range(n):
        if math.isnan(aim_t[i]):
            continue
        face = aim_p[i] - BALL_RADIUS_M * normals[i] - strokes.vs_mps[i] * aim_t[i]
        soft.place(starts[i], face, strokes.qs_wxyz[i], strokes.vs_mps[i])
        if soft.run_through("table") is None:
            continue
        left = soft.run_through("racket")
        if left is not None:
            hit_t[i], hits[i] = left, soft.ball()
    return follow_hits(hit_t, hits, config)
