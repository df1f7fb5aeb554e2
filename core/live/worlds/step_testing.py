"""Step test of the simulated robot: the latency of its commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from core.chain.control.step_test import CommandLatency, RacketStep, command_latency
from core.live.worlds.world import SimulatedWorld
from core.physics.rotation import base_orientation
from core.simulation.episodes.racket import RacketTarget

STEPS: Final = 12
STEP_M: Final = 0.05
"""To the side, from the resting place."""
TAKES_S: Final = 0.25
WATCHED_S: Final = 0.5
"""From the command on: latencies of up to 0.2 s are seen."""
REST_S: Final = 1.5
"""Time for the way back, s."""


def measure_steps(
    world: SimulatedWorld, command: Callable[[SimulatedWorld, RacketTarget], None], steps: int = STEPS
) -> CommandLatency:
    """Send the racket `steps` times to the side and back.

    Raises:
        ConfigError: if it does not move.
    """
    return command_latency([_step(world, command, STEP_M if k % 2 else -STEP_M) for k in range(steps)])


def _step(world: SimulatedWorld, command: Callable[[SimulatedWorld, RacketTarget], None], aside_m: float) -> RacketStep:
    sent_s, start = world.now_us * 1e-6, world.rally.racket.p_m.copy()
    there = start + np.array([0.0, aside_m, 0.0])
    q = base_orientation(world.config.task.stroke)
    command(world, RacketTarget(there, q, np.zeros(3), sent_s + TAKES_S))
    times, places = [], []
    while world.now_us * 1e-6 < sent_s + WATCHED_S:
        block = world.advance()
        times.append(1e-6 * block.racket_t_us)
        places.append(block.racket[:, :3])
    world.aim(None)
    while world.now_us * 1e-6 < sent_s + WATCHED_S + REST_S:
        world.advance()
    return RacketStep(sent_s, sent_s + TAKES_S, start, there, np.concatenate(times), np.concatenate(places))
