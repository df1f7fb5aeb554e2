"""The one-step task through the whole chain: simulated events, detection, stereo and prediction give the state.

Serve by serve, in one simulated world with event cameras. Nothing of the truth reaches the learner. As in the paper the
racket moves early, on the predictions before the bounce, and its orientation is decided on one after it. The world goes
on in blocks of 10 ms, and only then are its events seen.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, stereo_preset
from core.chain.chain import ChainState, RallyChain
from core.chain.config import ChainConfig, chain_for_physics
from core.config import check_settings, setting
from core.errors import ConfigError
from core.learning.config import EnvironmentConfig, RewardConfig
from core.learning.gym_environment import OneStepReturn
from core.learning.task.environment import ServeBatch
from core.learning.task.hit_places import HitPlaces
from core.live.worlds.world import Block, ClassifiedBall, SimulatedWorld, WorldConfig
from core.outcomes.perceived_backend import aim_racket, newest_prediction, with_prediction, without_prediction
from core.physics.episode import Outcomes
from core.simulation.episodes.ball_outcome import outcomes_of
from core.trajectory import HitPlane, predictor_for

Array = NDArray[np.float64]

LONGEST_BALL_S: Final = 5.0
"""No ball takes longer from the serve to its outcome."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EventEnvironmentConfig:
    """Settings of the perception and the time of the decision."""

    chain: ChainConfig = dataclasses.field(default_factory=ChainConfig)
    window_ms: float = setting(2.0, 0.2, 10.0)
    lead_ms: float = setting(50.0, 10.0, 200.0)
    """The stroke is decided on the newest prediction when so much time is left (choice: the racket turns 15 degrees in
    13 ms, moves 3 cm in 40 ms, and a block of 10 ms has to be over before its events are seen)."""

    knows_physics: bool = False
    """Whether the chain knows the physics exactly; otherwise it learns them for each ball."""

    def __post_init__(self) -> None:
        check_settings(self)


class EventCameraBackend:
    """A world with event cameras, a chain that watches the ball, and a racket. One thread; `close` it."""

    def __init__(
        self,
        environment: EnvironmentConfig,
        *,
        seed: int = 0,
        cameras: Mapping[str, Camera] | None = None,
        config: EventEnvironmentConfig | None = None,
        world: WorldConfig | None = None,
        on_step: Callable[[ChainState, float], None] | None = None,
    ) -> None:
        """The task of `world` is replaced by the environment's. `on_step` gets every step of the chain, and the time of
        the serve.
        """
        self._on_step = on_step
        self._environment = environment
        self._config = config or EventEnvironmentConfig()
        self._cameras = cameras = stereo_preset() if cameras is None else cameras
        task = environment.task
        self._seed = seed
        self._world_config = dataclasses.replace(world or WorldConfig(), task=task)
        self.world = SimulatedWorld(self._world_config, cameras, seed)
        chain = self._config.chain
        knows_physics = self._config.knows_physics
        table = predictor_for("real") if knows_physics and task.physics.has_air else chain.predictor
        predictor = dataclasses.replace(table, hit_x_m=task.stroke.hit_plane_x_m)
        ball = chain_for_physics(chain, task.physics).filter if knows_physics else chain.filter
        self._chain = RallyChain(cameras, dataclasses.replace(chain, predictor=predictor, filter=ball))
        self._places = HitPlaces(environment)
        self._served_s = 0.0
        self._judged: ClassifiedBall | None = None

    def begin(self, seed: int) -> None:
        """Take a new world, whose cameras draw their noise from this seed."""
        if self.world.now_us == 0 and seed == self._seed:
            return
        self.world.close()
        self.world = SimulatedWorld(self._world_config, self._cameras, seed)
        self._seed, self._served_s, self._judged = seed, 0.0, None

    def observe(self, batch: ServeBatch) -> ServeBatch:
        """Serve the ball of `batch` and watch it until the stroke has to be decided."""
        self._rest()
        serves = batch.serves
        self._served_s = self.world.serve(serves.ps_m[0], serves.vs_mps[0], serves.spins_radps[0]).t_s
        self._chain.reset()
        self._places.forget_flight()
        self._judged = None
        seen: HitPlane | None = None
        while self._judged is None and self.world.now_us * 1e-6 < self._served_s + LONGEST_BALL_S:
            newest = self._watch(self._advance())
            if newest is not None:
                seen = newest
                self._aim(self._as_observed(batch, seen), np.zeros((1, 3)))
            if seen is not None and seen.t_s - self.world.now_us * 1e-6 < self._config.lead_ms * 1e-3:
                return self._as_observed(batch, seen)
        return without_prediction(batch, self._environment)

    def play(self, batch: ServeBatch, action: Array) -> Outcomes:
        """Send the racket and wait for the outcome."""
        if batch.seen[0]:
            self._aim(batch, action)
        while self._judged is None:
            self._advance()
            if self.world.now_us * 1e-6 > self._served_s + LONGEST_BALL_S:
                raise ConfigError("a ball without an outcome", got=f"{LONGEST_BALL_S} s after the serve")
        return outcomes_of(self._judged.outcome, self._served_s)

    def close(self) -> None:
        """End the world's threads."""
        self.world.close()

    def _advance(self) -> Block:
        block = self.world.advance()
        for judged in block.outcomes:
            if judged.serve.t_s >= self._served_s:
                self._judged = judged
        return block

    def _watch(self, block: Block) -> HitPlane | None:
        """Process a block's events; returns the newest prediction."""

        def note(state: ChainState, place: HitPlane | None) -> None:
            if self._on_step is not None:
                self._on_step(state, self._served_s)

        return newest_prediction(self._chain, block, round(1000 * self._config.window_ms), self._places, note)

    def _as_observed(self, batch: ServeBatch, seen: HitPlane) -> ServeBatch:
        return with_prediction(batch, seen, self._served_s, self._environment)

    def _aim(self, batch: ServeBatch, action: Array) -> None:
        aim_racket(self.world.aim, batch, action, self._served_s, self._environment)

    def _rest(self) -> None:
        """Send the racket back and let the last ball roll out."""
        self.world.aim(None)
        while self.world.ball_is_visible:
            self.world.advance()


def event_environment(
    speed_mps: float = 5.0,
    *,
    environment: EnvironmentConfig | None = None,
    reward: RewardConfig | None = None,
    seed: int = 0,
) -> OneStepReturn:
    """The task as a Gymnasium environment, its states from events: `OneStepReturn` on an `EventCameraBackend`.

    Args:
        speed_mps: of the serves at the launcher.
        environment: the task; None: the paper's, with states from events.
        reward: None: the paper's.
        seed: of the sensor's noise.
    """
    config = environment or EnvironmentConfig(state_source="events")
    return OneStepReturn(speed_mps, config, reward, backend=EventCameraBackend(config, seed=seed))
