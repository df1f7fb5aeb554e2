"""Sessions of a cell: ten balls in one lab, whose constants and errors are drawn once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.robustness.cells import Cell
from benchmarks.robustness.wrong_wires import WrongWires, wrong_cameras
from core.cameras import stereo_preset
from core.chain.control.controller import BuiltInController, ControllerConfig
from core.chain.control.player import FREEZE_S, JITTERS
from core.chain.physics import expected_physics
from core.jobs.control import TaskControl
from core.live.worlds.closed_loop import ClosedLoop, PlayedBall
from core.live.worlds.step_testing import measure_steps
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.physics.config import PhysicsConfig
from core.physics.task import TaskConfig, task_profile
from core.trajectory.filter_config import UNKNOWN

Array = NDArray[np.float64]

SEED: Final = 20261124
BALLS: Final = 10
"""Of a session."""
MAX_SIGMAS: Final = 2.0
"""What a constant of a lab is drawn within, where the row does not say."""
SPEEDS_MPS: Final = (3.0, 9.0)
CONSTANTS: Final = ("drag", "restitution", "friction")


@dataclass(frozen=True, slots=True)
class CellSession:
    """A piece of work: balls of a cell."""

    cell: Cell
    number: int
    balls: int = BALLS


@dataclass(frozen=True, slots=True)
class PlayedSession:
    """What came of its balls."""

    returned: tuple[bool, ...]
    cases: tuple[str, ...]
    landing_m: tuple[float | None, ...]
    """From the goal to where a returned ball landed; None for others."""
    latency_error_ms: float | None
    """Of the step test; None without one."""


def play_session(session: CellSession, control: TaskControl | None = None) -> PlayedSession:
    """Play the balls of a session; which balls they are depends on its number alone."""
    cell, task = session.cell, task_profile("real")
    seed, rng = [SEED, session.number], np.random.default_rng([SEED, session.number, 1])
    task = replace(task, physics=lab_physics(cell, task.physics, rng))
    world, cameras = WorldConfig(task=task), stereo_preset()
    believed, wires = wrong_cameras(cell, cameras, rng), WrongWires(cell, cameras, rng)
    lead_ms, off_ms, jitter_s = _lead(cell, world, wires)
    loop = ClosedLoop(
        world,
        cameras,
        seed=int(np.random.SeedSequence(seed).generate_state(1)[0]),
        controller=_controller(cell, task, lead_ms),
        knows_physics=bool(cell.told),
        believed=believed,
        between=wires,
    )
    loop.player.freeze_s = FREEZE_S + JITTERS * jitter_s
    goal = BuiltInController(task).goal_m
    speeds = np.random.default_rng([SEED, session.number, 2]).uniform(*SPEEDS_MPS, session.balls)
    played: list[PlayedBall] = []
    try:
        for speed in speeds.tolist():
            wires.begin_ball(loop.world.now_us)
            played.append(loop.play(speed))
            if control is not None:
                control(len(played) / session.balls)
    finally:
        loop.close()
    landings = [float(np.linalg.norm(ball.judged.outcome.landing_m[:2] - goal)) for ball in played]
    return PlayedSession(
        returned=tuple(ball.returned for ball in played),
        cases=tuple(ball.judged.outcome.case.name.lower() for ball in played),
        landing_m=tuple(
            landing if ball.returned and math.isfinite(landing) else None
            for ball, landing in zip(played, landings, strict=True)
        ),
        latency_error_ms=off_ms,
    )


def lab_physics(cell: Cell, real: PhysicsConfig, rng: np.random.Generator) -> PhysicsConfig:
    """What air and table of a lab really are: drawn from what is expected, but for the constant of the cell, which is
    as far off as that says, up or down; the other two are as expected then.
    """
    signs = np.sign(rng.standard_normal(3))
    drawn = np.clip(rng.standard_normal(3), -MAX_SIGMAS, MAX_SIGMAS)
    if cell.constant is not None:
        drawn = np.where([name == cell.constant for name in CONSTANTS], signs * cell.sigmas, 0.0)
    drag, restitution, friction = (
        UNKNOWN[name] + float(by) * UNKNOWN[f"{name}_sigma"] for name, by in zip(CONSTANTS, drawn, strict=True)
    )
    expected = expected_physics(real)
    table = replace(expected.table, restitution=min(restitution, 0.995), friction=max(friction, 0.05))
    return replace(expected, air=replace(expected.air, drag_coefficient=drag), table=table)


def _lead(cell: Cell, world: WorldConfig, wires: WrongWires) -> tuple[float, float | None, float]:
    """By how much the controller leads, and how wrong the step test was, both in ms; the jitter that it found."""
    if not cell.latency_ms or not cell.led:
        return 0.0, None, 0.0
    tested = SimulatedWorld(world, {}, 0, threads=1)
    try:
        found = measure_steps(tested, wires.command)
    finally:
        tested.close()
    return max(0.0, 1e3 * found.mean_s), 1e3 * found.mean_s - cell.latency_ms, found.jitter_s


def _controller(cell: Cell, task: TaskConfig, lead_ms: float) -> BuiltInController:
    if not cell.told:
        task = replace(task, physics=expected_physics(task.physics))
    return BuiltInController(task, ControllerConfig(lead_ms=lead_ms))
