"""The one-step task through the whole chain: simulated events, detection, stereo and prediction give the state.

Serve by serve, in one simulated world with event cameras. Nothing of the truth reaches the learner. As in the paper the
racket moves early, on the predictions before the bounce, and its orientation is decided on one after it. The world goes
on in blocks of 10 ms, and only then are its events seen.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, stereo_preset
from core.chain.block_windows import block_windows
from core.chain.chain import ChainState, RallyChain
from core.chain.config import ChainConfig
from core.chain.physics import chain_for_physics
from core.config import check_settings, setting
from core.errors import ConfigError
from core.learning.config import EnvironmentConfig, RewardConfig
from core.learning.gym_environment import OneStepReturn
from core.learning.task.environment import ServeBatch, strokes_of
from core.learning.task.normalise import STATE_SIZES
from core.learning.task.perception import state_of
from core.live.worlds.outcomes import outcomes_of
from core.live.worlds.world import Block, ClassifiedBall, SimulatedWorld, WorldConfig
from core.physics.episode import Outcomes
from core.simulation.episodes.racket import target_for_ball
from core.trajectory import HitPlane, predictor_for

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

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
        self._served_s = 0.0
        self._judged: ClassifiedBall | None = None

    def begin(self, seed: int) -> None:
        """Take a new world, whose cameras draw their noise from this seed."""
        if self.world.now_us == 0 and seed == self._seed:
            return
        self.world.close()
        self.world = SimulatedWorld(self._world_config, self._cameras, seed)
        self._seed, self._served_s, self._judged = seed, 0.0, None

    def observe(self, delivery: ServeBatch) -> ServeBatch:
        """Serve the ball of `delivery` and watch it until the stroke has to be decided."""
        self._rest()
        serves = delivery.serves
        self._served_s = self.world.serve(serves.ps_m[0], serves.vs_mps[0], serves.spins_radps[0]).t_s
        self._chain.reset()
        self._judged = None
        seen: HitPlane | None = None
        while self._judged is None and self.world.now_us * 1e-6 < self._served_s + LONGEST_BALL_S:
            newest = self._watch(self._advance())
            if newest is not None:
                seen = newest
                self._aim(self._as_delivered(delivery, seen), np.zeros((1, 3)))
            if seen is not None and seen.t_s - self.world.now_us * 1e-6 < self._config.lead_ms * 1e-3:
                return self._as_delivered(delivery, seen)
        # Never seen, or never predicted to come: an outcome is all there is.
        nothing = np.full((1, 3), np.nan), np.full(1, np.nan)
        states = np.zeros((1, STATE_SIZES[self._environment.state]))
        return dataclasses.replace(
            delivery, seen=np.array([False]), states=states, aim_ps_m=nothing[0], aim_t_s=nothing[1]
        )

    def play(self, delivery: ServeBatch, action: Array) -> Outcomes:
        """Send the racket and wait for the outcome."""
        if delivery.seen[0]:
            self._aim(delivery, action)
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
        window_us = round(1000 * self._config.window_ms)
        found = None
        for windows in block_windows(block.events, block.start_us, block.end_us, window_us):
            state = self._chain.step(windows)
            if self._on_step is not None:
                self._on_step(state, self._served_s)
            if state.is_new and state.prediction is not None and state.prediction.hit_plane is not None:
                found = state.prediction.hit_plane
        return found

    def _as_delivered(self, delivery: ServeBatch, seen: HitPlane) -> ServeBatch:
        p = seen.p_world_m
        return dataclasses.replace(
            delivery,
            seen=np.array([True]),
            states=state_of(seen, self._environment.state)[None],
            aim_ps_m=p[None].copy(),
            aim_t_s=np.array([seen.t_s - self._served_s]),
        )

    def _aim(self, delivery: ServeBatch, action: Array) -> None:
        """Let the racket meet the expected ball with this action's orientation, if it can."""
        strokes = strokes_of(delivery, action, self._environment)
        assert strokes.aim_ps_m is not None and strokes.aim_t_s is not None
        t_s = self._served_s + float(strokes.aim_t_s[0])
        try:
            self.world.aim(target_for_ball(strokes.aim_ps_m[0], strokes.qs_wxyz[0], strokes.vs_mps[0], t_s))
        except ConfigError as error:
            logger.info("racket target refused: %s", error)

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
    """The task as a Gymnasium environment, its states from events: `OneStepReturn` on an `EventCameraBackend`."""
    config = environment or EnvironmentConfig(state_source="events")
    return OneStepReturn(speed_mps, config, reward, backend=EventCameraBackend(config, seed=seed))
