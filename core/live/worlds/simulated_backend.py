"""The simulated world as an environment backend: only events come out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, stereo_preset
from core.live.worlds.world import Block, SimulatedWorld, WorldConfig
from core.outcomes.environment_backend import SeenBlock
from core.physics.task import TaskConfig
from core.simulation.episodes.racket import RacketTarget

Array = NDArray[np.float64]


class SimulatedBackend:
    """Two event cameras of a preset, a launcher and a racket, simulated in blocks of 10 ms. `close` it."""

    def __init__(
        self,
        task: TaskConfig,
        *,
        seed: int = 0,
        cameras: Mapping[str, Camera] | None = None,
        world: WorldConfig | None = None,
        on_block: Callable[[Block], None] = lambda block: None,
    ) -> None:
        """The task of `world` is replaced. `on_block` gets the true blocks, for benchmarks."""
        self._config = dataclasses.replace(world or WorldConfig(), task=task)
        self._cameras = dict(stereo_preset() if cameras is None else cameras)
        self._seed, self._on_block = seed, on_block
        self._world = SimulatedWorld(self._config, self._cameras, seed)

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Cameras by name."""
        return self._cameras

    @property
    def now_us(self) -> int:
        """End of the newest block."""
        return self._world.now_us

    def begin(self, seed: int) -> None:
        """Take a new world, whose cameras draw their noise from this seed."""
        if self._world.now_us == 0 and seed == self._seed:
            return
        self._world.close()
        self._seed, self._world = seed, SimulatedWorld(self._config, self._cameras, seed)

    def serve(self, p_m: Array, v_mps: Array, spin_radps: Array) -> None:
        """Launch this ball."""
        self._world.serve(p_m, v_mps, spin_radps)

    def aim(self, target: RacketTarget | None) -> None:
        """Send the racket there, or to rest.

        Raises:
            ConfigError: if it is out of bounds.
        """
        self._world.aim(target)

    def advance(self) -> SeenBlock:
        """Simulate a block."""
        block = self._world.advance()
        self._on_block(block)
        return SeenBlock(block.start_us, block.end_us, block.events)

    def close(self) -> None:
        """End the world's threads."""
        self._world.close()
