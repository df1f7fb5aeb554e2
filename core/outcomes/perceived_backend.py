"""The one-step task from cameras alone: state, speed and time of the serve, and the outcome."""

from __future__ import annotations

import dataclasses
import logging
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.block_windows import block_windows
from core.chain.chain import RallyChain
from core.chain.config import ChainConfig
from core.errors import ConfigError
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import ServeBatch, strokes_of
from core.learning.task.normalise import STATE_SIZES
from core.learning.task.perception import state_of
from core.outcomes.ball_log import ServeSeen
from core.outcomes.classifier import NOT_SEEN_AGAIN, ClassifiedStroke, OutcomeClassifier, missed_stroke
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.environment_backend import EnvironmentBackend, SeenBlock
from core.physics.episode import Case, Outcomes
from core.simulation.episodes.racket import target_for_ball
from core.trajectory import HitPlane

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

WINDOW_US: Final = 2000
LONGEST_US: Final = 5_000_000
"""Longest duration of a ball."""
SILENT_US: Final = 1_500_000
"""A ball unseen for this long after the serve command did not come (choice)."""
QUIET_US: Final = 150_000
REST_US: Final = 2_000_000
"""Rest between two balls: until nothing was seen for the first time, at most the second."""
LEAD_US: Final = 50_000
"""Time before the impact at which the stroke is decided, as with outcomes from the simulation."""


class PerceivedBackend:
    """Plays balls in an environment backend and classifies them itself, without truth or known constants."""

    def __init__(
        self,
        environment: EnvironmentConfig,
        world_backend: EnvironmentBackend,
        *,
        chain: ChainConfig | None = None,
        judge: OutcomeClassifierConfig | None = None,
    ) -> None:
        """The chain learns the physical constants by itself.

        Raises:
            CalibrationError: if the cameras cannot see depth.
        """
        hit_x_m = environment.task.stroke.hit_plane_x_m
        config = chain or ChainConfig()
        predictor = dataclasses.replace(config.predictor, hit_x_m=hit_x_m)
        self._environment, self._world_backend = environment, world_backend
        self._chain = RallyChain(world_backend.cameras, dataclasses.replace(config, predictor=predictor))
        self._judge = OutcomeClassifier(judge, hit_x_m=hit_x_m)
        self.served_us = 0
        """Time of the serve command, us."""
        self.judged: ClassifiedStroke | None = None
        """Classification of the last ball."""

    @property
    def serve_seen(self) -> ServeSeen | None:
        """The last serve as observed; None if it was not seen."""
        return self._judge.serve

    def begin(self, seed: int) -> None:
        """Restart the environment."""
        self._world_backend.begin(seed)
        self._chain.reset()
        self._judge.reset()

    def observe(self, delivery: ServeBatch) -> ServeBatch:
        """Serve a ball, and observe it until the stroke has to be decided."""
        self._rest()
        serves = delivery.serves
        self.served_us, self.judged = self._world_backend.now_us, None
        self._chain.reset()
        self._judge.begin()
        self._world_backend.serve(serves.ps_m[0], serves.vs_mps[0], serves.spins_radps[0])
        seen: HitPlane | None = None
        while self.judged is None and not self._nothing_comes():
            newest = self._watch(self._world_backend.advance())
            serve = self._judge.serve
            if serve is None:
                continue
            if newest is not None:
                seen = newest
                self._aim(self._as_seen(delivery, seen, serve), np.zeros((1, 3)))
            if seen is not None and 1e6 * seen.t_s - self._world_backend.now_us < LEAD_US:
                return self._as_seen(delivery, seen, serve)
        self._judge_unseen()
        return dataclasses.replace(
            delivery,
            seen=np.array([False]),
            states=np.zeros((1, STATE_SIZES[self._environment.state])),
            aim_ps_m=np.full((1, 3), np.nan),
            aim_t_s=np.full(1, np.nan),
        )

    def play(self, delivery: ServeBatch, action: Array) -> Outcomes:
        """Send the racket, and observe the outcome. Times count from the first observation of the serve."""
        if delivery.seen[0]:
            self._aim(delivery, action)
        while self.judged is None and self._world_backend.now_us - self.served_us < LONGEST_US:
            self._watch(self._world_backend.advance())
        self._judge_unseen()
        assert self.judged is not None
        return outcomes_as_judged(self.judged, self._origin_us())

    def close(self) -> None:
        """Close the environment."""
        self._world_backend.close()

    def _origin_us(self) -> int:
        serve = self._judge.serve
        return self.served_us if serve is None else serve.t_us

    def _nothing_comes(self) -> bool:
        passed_us = self._world_backend.now_us - self.served_us
        return passed_us > LONGEST_US or (passed_us > SILENT_US and not self._judge.has_points)

    def _judge_unseen(self) -> None:
        if self.judged is None:
            self.judged = self._judge.newest or missed_stroke(self._world_backend.now_us, NOT_SEEN_AGAIN)

    def _watch(self, block: SeenBlock) -> HitPlane | None:
        """Process a block's events; returns the newest prediction, and stores a classification."""
        found = None
        for windows in block_windows(block.events, block.start_us, block.end_us, WINDOW_US):
            state = self._chain.step(windows)
            self.judged = self._judge.step(state) or self.judged
            if state.is_new and state.prediction is not None and state.prediction.hit_plane is not None:
                found = state.prediction.hit_plane
        return found

    def _as_seen(self, delivery: ServeBatch, seen: HitPlane, serve: ServeSeen) -> ServeBatch:
        racket_mps = self._environment.task.stroke.racket_speed.at(serve.speed_mps)
        return dataclasses.replace(
            delivery,
            seen=np.array([True]),
            states=state_of(seen, self._environment.state)[None],
            aim_ps_m=seen.p_world_m[None].copy(),
            aim_t_s=np.array([seen.t_s - serve.t_us * 1e-6]),
            racket_speeds_mps=np.array([racket_mps]),
        )

    def _aim(self, delivery: ServeBatch, action: Array) -> None:
        strokes = strokes_of(delivery, action, self._environment)
        assert strokes.aim_ps_m is not None and strokes.aim_t_s is not None
        t_s = self._origin_us() * 1e-6 + float(strokes.aim_t_s[0])
        try:
            self._world_backend.aim(target_for_ball(strokes.aim_ps_m[0], strokes.qs_wxyz[0], strokes.vs_mps[0], t_s))
        except ConfigError as error:
            logger.info("racket target refused: %s", error)

    def _rest(self) -> None:
        """Send the racket to rest, and wait until the last ball is out of sight."""
        self._world_backend.aim(None)
        begun_us = quiet_us = self._world_backend.now_us
        while (
            self._judge.has_points and quiet_us - begun_us < REST_US and self._world_backend.now_us - begun_us < REST_US
        ):
            block = self._world_backend.advance()
            for windows in block_windows(block.events, block.start_us, block.end_us, WINDOW_US):
                if self._chain.step(windows).point is not None:
                    quiet_us = block.end_us
            if block.end_us - quiet_us >= QUIET_US:
                break


def outcomes_as_judged(judged: ClassifiedStroke, origin_us: int) -> Outcomes:
    """Outcomes with one row from a classification, with times since `origin_us`. Spins are unknown (NaN)."""

    def since_s(t_us: float) -> Array:
        return np.array([(t_us - origin_us) * 1e-6])

    spin = np.full(3, np.nan)
    landing = np.concatenate([judged.landing_m, judged.landing_v_mps, spin])[None]
    contact = np.concatenate([judged.contact_m, judged.landing_v_mps, spin])[None]
    landing_t_s = since_s(judged.landing_us)
    if judged.case is Case.NET:
        # It touched the net before it would have come down.
        contact[0, 0], landing_t_s[0] = 0.0, np.inf
    return Outcomes(
        case=np.array([judged.case], np.int8),
        hit_t_s=since_s(judged.hit_us),
        hit_states=np.concatenate([judged.hit_state, spin])[None],
        landing_t_s=landing_t_s,
        landing_states=landing,
        net_z_m=np.array([judged.net_z_m]),
        contact_t_s=since_s(judged.contact_us),
        contact_states=contact,
    )
