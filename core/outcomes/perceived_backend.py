"""The one-step task from cameras alone: state, speed and time of the serve, and the outcome."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Mapping
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import ChainState, RallyChain
from core.chain.config import WINDOW_US, ChainConfig
from core.detection.window import block_windows
from core.errors import ConfigError
from core.events import Events
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import ServeBatch, strokes_of
from core.learning.task.hit_places import HitPlaces
from core.learning.task.normalise import STATE_SIZES
from core.learning.task.perception import state_of
from core.outcomes.ball_log import ServeSeen
from core.outcomes.classifier import NOT_SEEN_AGAIN, OutcomeClassifier
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.environment_backend import EnvironmentBackend, SeenBlock
from core.outcomes.stroke import ClassifiedStroke, missed_stroke
from core.physics.episode import Case, Outcomes
from core.simulation.episodes.racket import RacketTarget, target_for_ball
from core.trajectory import HitPlane

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

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
        self._places = HitPlaces(environment)
        self._met: HitPlane | None = None
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

    def observe(self, batch: ServeBatch) -> ServeBatch:
        """Serve a ball, and observe it until the stroke has to be decided."""
        self._rest()
        serves = batch.serves
        self.served_us, self.judged = self._world_backend.now_us, None
        self._chain.reset()
        self._places.forget_flight()
        self._met = None
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
                self._aim(self._as_seen(batch, seen, serve), np.zeros((1, 3)))
            if seen is not None and 1e6 * seen.t_s - self._world_backend.now_us < LEAD_US:
                return self._as_seen(batch, seen, serve)
        self._judge_unseen()
        return without_prediction(batch, self._environment)

    def play(self, batch: ServeBatch, action: Array) -> Outcomes:
        """Send the racket, and observe the outcome. Times count from the first observation of the serve."""
        if batch.seen[0]:
            self._aim(batch, action)
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

        def judge(state: ChainState, place: HitPlane | None) -> None:
            self._met = place or self._met
            self.judged = self._judge.step(state, None if state.prediction is None else self._met) or self.judged

        return newest_prediction(self._chain, block, WINDOW_US, self._places, judge)

    def _as_seen(self, batch: ServeBatch, seen: HitPlane, serve: ServeSeen) -> ServeBatch:
        racket_mps = self._environment.task.stroke.racket_speed.at(serve.speed_mps)
        observed = with_prediction(batch, seen, serve.t_us * 1e-6, self._environment)
        return dataclasses.replace(observed, racket_speeds_mps=np.array([racket_mps]))

    def _aim(self, batch: ServeBatch, action: Array) -> None:
        aim_racket(self._world_backend.aim, batch, action, self._origin_us() * 1e-6, self._environment)

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


class SeenEvents(Protocol):
    """Events of several cameras over a time."""

    @property
    def start_us(self) -> int: ...
    @property
    def end_us(self) -> int: ...
    @property
    def events(self) -> Mapping[str, Events]: ...


def newest_prediction(
    chain: RallyChain,
    block: SeenEvents,
    window_us: int,
    places: HitPlaces,
    on_step: Callable[[ChainState, HitPlane | None], None],
) -> HitPlane | None:
    """The newest prediction of the place of the hit after the chain has taken a block's windows; None without one.

    Args:
        chain: takes the windows.
        block: events of all cameras over a time.
        window_us: length of a window.
        places: says where the ball is met.
        on_step: gets each step, and where the ball is met by it.
    """
    found = None
    for windows in block_windows(block.events, block.start_us, block.end_us, window_us):
        state = chain.step(windows)
        place = places.of(state)
        on_step(state, place)
        found = place or found
    return found


def with_prediction(batch: ServeBatch, seen: HitPlane, served_s: float, environment: EnvironmentConfig) -> ServeBatch:
    """The batch of one serve with the state and the aim that a prediction gives; its times count from the serve.

    Args:
        batch: of one serve.
        seen: the prediction, its times on the chain's clock.
        served_s: time of the serve on that clock.
        environment: which kind of state.
    """
    return dataclasses.replace(
        batch,
        seen=np.array([True]),
        states=state_of(seen, environment.state)[None],
        aim_ps_m=seen.p_world_m[None].copy(),
        aim_t_s=np.array([seen.t_s - served_s]),
    )


def without_prediction(batch: ServeBatch, environment: EnvironmentConfig) -> ServeBatch:
    """The batch of a serve that was never seen, or never predicted to come: an outcome is all there is."""
    return dataclasses.replace(
        batch,
        seen=np.array([False]),
        states=np.zeros((1, STATE_SIZES[environment.state])),
        aim_ps_m=np.full((1, 3), np.nan),
        aim_t_s=np.full(1, np.nan),
    )


def aim_racket(
    aim: Callable[[RacketTarget], object],
    batch: ServeBatch,
    action: Array,
    served_s: float,
    environment: EnvironmentConfig,
) -> None:
    """Let the racket meet the expected ball with this action's orientation; a target that it refuses is logged.

    Args:
        aim: sends the racket to a target; raises ConfigError if it cannot go there.
        batch: one serve as `with_prediction` gives it.
        action: (1, 3) in [-1, 1].
        served_s: time of the serve on the cameras' clock, s.
        environment: gives the stroke's limits.
    """
    strokes = strokes_of(batch, action, environment)
    assert strokes.aim_ps_m is not None and strokes.aim_t_s is not None
    t_s = served_s + float(strokes.aim_t_s[0])
    try:
        aim(target_for_ball(strokes.aim_ps_m[0], strokes.qs_wxyz[0], strokes.vs_mps[0], t_s))
    except ConfigError as error:
        logger.info("racket target refused: %s", error)


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
