"""The simulated physics: speed, agreement of closed form and MuJoCo, soft contacts, and how hard the task is untrained.

A row per physics profile and serve speed. The racket's action is uniformly random unless said; seeds are fixed.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from typing import Final, Literal

import numpy as np

from benchmarks.machine import describe_machine
from benchmarks.partial_rows import report_rows_to
from core.physics import Serves, Strokes, TaskConfig, strokes_from_actions
from core.physics.impact import strike, surfaces_from_config
from core.physics.task import STAGE_SPEEDS_MPS, task_profile
from core.simulation.episodes import draw_serves, fly_serves, return_balls, simulate_episodes
from core.simulation.episodes.mujoco_episode import simulate_episodes_mujoco
from core.simulation.episodes.mujoco_rally import MujocoRally
from core.simulation.episodes.mujoco_soft import SoftTable, drop_on, simulate_episodes_soft

BALLS: Final = 150
"""Per speed, profile and step: 1,050 over the seven speeds."""
UNTRAINED_BALLS: Final = 20_000
SPEED_EPISODES: Final = 200_000
DROPS: Final = 300
STEPS_S: Final = (0.01, 0.001)
PROFILES: Final[tuple[Literal["paper", "real"], ...]] = ("paper", "real")
CLOCK: Final = "thread CPU time of one core; episodes_per_s in the rows is wall clock"

Progress = Callable[[float], None]
Row = dict[str, object]


def run(progress: Progress) -> dict[str, object]:
    """Rows per profile and speed, the speed of everything, the soft contacts, and the machine."""
    rows: list[Row] = []
    cases = list(itertools.product(PROFILES, STAGE_SPEEDS_MPS))
    for profile, speed in cases:
        task = task_profile(profile)
        row: Row = {"physics": profile, "speed_mps": speed} | untrained_returns(task, speed, UNTRAINED_BALLS)
        for dt_s in STEPS_S:
            row |= compare_physics(task, speed, dt_s, BALLS)
        rows.append(row)
        report_rows_to(progress, rows[-1:], 0.9 * len(rows) / len(cases))
    speed = throughput(SPEED_EPISODES)
    progress(0.93)
    soft = [soft_drops(surface, dt_s, DROPS) for surface in ("table", "racket") for dt_s in (0.0005, 0.001)]
    transfer = [soft_episodes(speed_mps, BALLS) for speed_mps in (3.0, 5.0, 9.0)]
    progress(1.0)
    return {
        "rows": rows,
        "speed": speed,
        "soft_impacts": soft,
        "soft_episodes": transfer,
        "machine": describe_machine("numpy", "numba", "mujoco", clock=CLOCK),
    }


def random_episodes(task: TaskConfig, speed_mps: float, count: int, seed: int) -> tuple[Serves, Strokes]:
    """Serves of one speed with uniformly random actions."""
    rng = np.random.default_rng(seed)
    serves = draw_serves(speed_mps, count, task, rng)
    racket = task.stroke.racket_speed.at(speed_mps)
    return serves, strokes_from_actions(rng.uniform(-1, 1, (count, 3)), racket, task.stroke)


def untrained_returns(task: TaskConfig, speed_mps: float, count: int) -> Row:
    """Share of balls that come back under action zero and under uniformly random actions."""
    serves, strokes = random_episodes(task, speed_mps, count, seed=1)
    arrivals = fly_serves(serves, task)
    zero = strokes_from_actions(np.zeros((count, 3)), task.stroke.racket_speed.at(speed_mps), task.stroke)
    return {
        "zero_action_returned": round(float(return_balls(arrivals, zero, task).returned.mean()), 4),
        "random_action_returned": round(float(return_balls(arrivals, strokes, task).returned.mean()), 4),
    }


def compare_physics(task: TaskConfig, speed_mps: float, dt_s: float, count: int) -> Row:
    """How far the MuJoCo rally at one step is from the closed form on the same balls."""
    serves, strokes = random_episodes(task, speed_mps, count, seed=2)
    ours = simulate_episodes(serves, strokes, task)
    began = time.perf_counter()
    theirs = simulate_episodes_mujoco(serves, strokes, task, dt_s=dt_s)
    seconds = time.perf_counter() - began
    dt = f"dt_{dt_s * 1e3:g}ms"
    off = np.linalg.norm(ours.landings_m - theirs.landings_m, axis=1)
    return {
        f"same_case_{dt}": float((ours.case == theirs.case).mean()),
        f"landing_max_mm_{dt}": float(np.nanmax(off)) * 1e3,
        f"net_height_max_mm_{dt}": float(np.nanmax(np.abs(ours.net_z_m - theirs.net_z_m))) * 1e3,
        f"episodes_per_s_{dt}": round(count / seconds, 1),
    }


def throughput(count: int) -> Row:
    """Episodes per second of the closed form, and how much faster than real time a MuJoCo rally steps."""
    result: Row = {}
    for profile in PROFILES:
        task = task_profile(profile)
        episodes = count if profile == "paper" else count // 10
        serves, strokes = random_episodes(task, 5.0, episodes, seed=3)
        simulate_episodes(serves, strokes, task)
        best = math.inf
        for _ in range(3):
            began = time.thread_time()
            simulate_episodes(serves, strokes, task)
            best = min(best, time.thread_time() - began)
        result[f"{profile}_episodes_per_s"] = round(episodes / best)
        for dt_s in STEPS_S:
            result[f"{profile}_mujoco_times_real_time_dt_{dt_s * 1e3:g}ms"] = round(_rally_pace(task, dt_s), 1)
    return result


def _rally_pace(task: TaskConfig, dt_s: float, served: int = 20) -> float:
    """Simulated seconds per second of a rally with a ball in the air all the time."""
    serves, _ = random_episodes(task, 5.0, served, seed=4)
    rally = MujocoRally(task, dt_s=dt_s)
    simulated = 0.0
    began = time.thread_time()
    for i in range(served):
        rally.reset()
        rally.serve(serves.ps_m[i], serves.vs_mps[i])
        while rally.playing and rally.time_s < 1.0:
            rally.step()
        simulated += rally.time_s
    return simulated / (time.thread_time() - began)


def soft_drops(surface: Literal["table", "racket"], dt_s: float, count: int) -> Row:
    """Restitution and tangential impulse of soft contacts against the rigid ones: oblique drops of 2 to 8 m/s."""
    task = task_profile("paper")
    rigid = surfaces_from_config(task.physics)[0 if surface == "table" else 1]
    soft = SoftTable(task, dt_s=dt_s)
    rng = np.random.default_rng(5)
    kept, ratios = np.empty(count), np.empty(count)
    for k in range(count):
        angle, around = np.radians(rng.uniform(20, 70)), rng.uniform(0, 2 * math.pi)
        along = math.sin(angle) * np.array([0, math.cos(around), math.sin(around)])
        velocity = rng.uniform(2, 8) * (along - [math.cos(angle), 0, 0])
        after = drop_on(soft, surface, velocity, rng.uniform(0.001, 0.010))
        expected = np.concatenate([np.zeros(3), velocity, np.zeros(3)])
        strike(expected, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), rigid)
        kept[k] = -after[0] / velocity[0]
        ratios[k] = np.linalg.norm(after[1:3] - velocity[1:3]) / np.linalg.norm(expected[4:6] - velocity[1:3])
    return {
        "surface": surface,
        "dt_ms": dt_s * 1e3,
        "restitution_wanted": rigid.restitution,
        "restitution_mean": round(float(kept.mean()), 4),
        "restitution_std": round(float(kept.std()), 4),
        "tangential_ratio_mean": round(float(ratios.mean()), 4),
        "tangential_ratio_std": round(float(ratios.std()), 4),
    }


def soft_episodes(speed_mps: float, count: int) -> Row:
    """How far whole episodes with soft impacts are from the rigid ones."""
    task = task_profile("paper")
    serves, strokes = random_episodes(task, speed_mps, count, seed=6)
    rigid, soft = simulate_episodes(serves, strokes, task), simulate_episodes_soft(serves, strokes, task)
    off = np.linalg.norm(rigid.landings_m - soft.landings_m, axis=1) * 1e3
    return {
        "speed_mps": speed_mps,
        "same_case": round(float((rigid.case == soft.case).mean()), 4),
        "landing_median_mm": round(float(np.nanmedian(off)), 1),
        "landing_p95_mm": round(float(np.nanpercentile(off, 95)), 1),
    }
