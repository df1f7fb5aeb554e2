"""Whole balls through perception: serve, events, detection, stereo, prediction, racket, outcome.

Nothing of the truth reaches the racket. The world advances in blocks of 10 ms, and only then are its events seen: that
is the delay of the perception here, on top of the window.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.chain.chain import BallPoint, RallyChain
from core.chain.config import ChainConfig, HitRule, chain_for_physics, expected_physics
from core.chain.control.controller import BuiltInController, Controller, RacketDecision
from core.chain.control.hit_choice import HitChoice, HitChoiceConfig, RacketReach
from core.chain.control.player import Player, PlayerState
from core.chain.follow import true_positions
from core.chain.time_aligner import AlignedPixels
from core.detection import Detection
from core.detection.window import block_windows
from core.errors import ConfigError
from core.events import Events, Window
from core.live.worlds.world import Block, ClassifiedBall, SimulatedWorld, WorldConfig
from core.physics.episode import Case
from core.recordings import BallTruth
from core.simulation.episodes.incoming import RecordedServes
from core.simulation.episodes.racket import RacketTarget

logger = logging.getLogger(__name__)
Array = NDArray[np.float64]

LONGEST_BALL_S = 5.0
"""No ball takes longer from the serve to its outcome; the simulation would be stuck."""
REST_S = 0.15
"""Quiet after an outcome, longer than the gap at which the chain forgets a flight."""


@dataclass(frozen=True, slots=True, eq=False)
class PlayedBall:
    """One ball, and the results of the chain."""

    speed_mps: float
    judged: ClassifiedBall
    decisions: tuple[RacketDecision, ...]
    """Decisions in their order; the last one is what the racket did."""
    aim_error_m: float
    """From where the ball was hit, or without a hit was at the same x, to where it was expected; NaN without a command,
    or where the ball never came so far."""
    choice: HitChoice | None = None
    """The last choice of where it is to be hit; None at the paper's plane."""

    @property
    def returned(self) -> bool:
        """Case 4."""
        return self.judged.outcome.case is Case.RETURNED

    @property
    def stage(self) -> str:
        """Stage of the last command: none, pre or post."""
        return self.decisions[-1].stage if self.decisions else "none"


class Between(Protocol):
    """Faults between the world and the player."""

    def seen(self, events: Mapping[str, Events], start_us: int, end_us: int) -> Mapping[str, Events]:
        """Events of a block after the faults, by camera."""
        ...

    def command(self, world: SimulatedWorld, target: RacketTarget) -> None:
        """Give the racket a target.

        Raises:
            ConfigError: if it is out of bounds.
        """
        ...


class _PointChain(RallyChain):
    """The chain with points that are not from cameras: all but detection and stereo."""

    def __init__(
        self, cameras: Mapping[str, Camera], config: ChainConfig, sigma_m: float, rng: np.random.Generator
    ) -> None:
        super().__init__(cameras, config)
        self._sigma_m, self._rng = sigma_m, rng
        self._empty = {name: Events.empty(camera.sensor) for name, camera in cameras.items()}
        self._truth: BallTruth | None = None

    def look(self, truth: BallTruth) -> Mapping[str, Events]:
        """Take the ball of a block; returns the events that its windows hold, none."""
        self._truth = truth
        return self._empty

    def _triangulate(
        self, detections: dict[str, Detection | None], windows: Mapping[str, Window]
    ) -> tuple[BallPoint | None, AlignedPixels | None]:
        window = next(iter(windows.values()))
        t_us = (window.start_us + window.end_us) // 2
        noise_m = self._rng.normal(0.0, self._sigma_m, 3)  # also without a ball: what one sees changes no other's noise
        true_m = np.full(3, np.nan) if self._truth is None else true_positions(self._truth, t_us)[0]
        if not np.isfinite(true_m).all():
            return None, None
        pixels = dict.fromkeys(self._empty, (0.0, 0.0))  # of several cameras, as a point of one counts less
        return BallPoint(t_us, true_m + noise_m, 0.0, self._sigma_m**2 * np.eye(3), pixels), None


class ClosedLoop:
    """A simulated world, and a chain and a controller that play in it."""

    def __init__(
        self,
        world: WorldConfig,
        cameras: Mapping[str, Camera],
        *,
        seed: int,
        chain: ChainConfig | None = None,
        controller: Controller | None = None,
        window_us: int = 2000,
        recorded: RecordedServes | None = None,
        knows_physics: bool = False,
        believed: Mapping[str, Camera] | None = None,
        between: Between | None = None,
        hit: HitRule = "paper",
        point_sigma_m: float | None = None,
        choice: HitChoiceConfig | None = None,
    ) -> None:
        """By default the built-in controller plays, and the chain learns the physical constants and passes them on to
        it. With `knows_physics` both get the world's exact constants. The built-in controller knows the racket's
        rubber. `believed`: the cameras as they were calibrated, where that is not what they are.

        `hit`, `choice`: where balls are met, see `Player`.

        With `recorded`, the balls that are served are of those. With `point_sigma_m` no camera looks: the chain gets
        the ball's true place with noise of that standard deviation along each axis, a point a window.

        Raises:
            CalibrationError: if the cameras cannot see depth.
        """
        seen, threads = (cameras, None) if point_sigma_m is None else ({}, 1)
        self.world = SimulatedWorld(world, seen, seed, threads=threads, recorded=recorded)
        config, task = chain or ChainConfig(), world.task
        if knows_physics:
            config = chain_for_physics(config, task.physics)
        else:
            task = replace(task, physics=expected_physics(task.physics))
        self._points: _PointChain | None = None
        if point_sigma_m is not None:
            self._points = _PointChain(cameras, config, point_sigma_m, np.random.default_rng([seed, 1]))
        self.player = Player(
            self._points or RallyChain(believed or cameras, config),
            controller or BuiltInController(task),
            hit=hit,
            reach=RacketReach.of_config(world.racket),
            choice=choice,
        )
        self._window_us = window_us
        self._between = between

    def play(self, speed_mps: float, on_block: Callable[[Block, list[PlayerState]], None] | None = None) -> PlayedBall:
        """Serve one ball of a speed and play it to its outcome; `on_block` gets every block and its steps.

        Raises:
            ConfigError: if there is no legal serve of that speed.
        """
        self.world.draw_serve(speed_mps)
        self.player.forget_flight()
        decisions: list[RacketDecision] = []
        flown: list[BallTruth] = []
        choice: HitChoice | None = None
        end_us = self.world.now_us + round(1e6 * LONGEST_BALL_S)
        while self.world.now_us < end_us:
            block = self.world.advance()
            states = list(self._perceive(block))
            if on_block is not None:
                on_block(block, states)
            flown.append(block.ball)
            choice = next((state.choice for state in reversed(states) if state.choice is not None), choice)
            decided = [self._decide(state) for state in states]
            decisions += [decision for decision in decided if decision is not None]
            if block.outcomes:
                judged = block.outcomes[0]
                self._rest()
                error_m = _aim_error_m(judged, decisions, flown)
                return PlayedBall(speed_mps, judged, tuple(decisions), error_m, choice)
        raise ConfigError("a ball without an outcome", got=f"{LONGEST_BALL_S} s after a {speed_mps:g} m/s serve")

    def _rest(self) -> None:
        """Wait until the ball is at rest and the racket at home."""
        quiet_us = 0
        while quiet_us < round(1e6 * REST_S):
            block = self.world.advance()
            for _ in self._perceive(block):
                pass
            quiet_us = 0 if self.world.ball_is_visible else quiet_us + block.end_us - block.start_us

    def close(self) -> None:
        """End the world's threads."""
        self.world.close()

    def _perceive(self, block: Block) -> Iterator[PlayerState]:
        events = block.events
        if self._points is not None:
            events = self._points.look(block.ball)
        if self._between is not None:
            events = self._between.seen(events, block.start_us, block.end_us)
        for windows in block_windows(events, block.start_us, block.end_us, self._window_us):
            yield self.player.step(windows)

    def _decide(self, state: PlayerState) -> RacketDecision | None:
        """Send the racket a new decision, if there is time and it is in reach."""
        decision = state.decision
        if decision is None or not state.is_new or decision.target.t_s <= self.world.now_us * 1e-6:
            return None
        try:
            if self._between is None:
                self.world.aim(decision.target)
            else:
                self._between.command(self.world, decision.target)
        except ConfigError as error:
            logger.info("racket target refused: %s", error)
            return None
        return decision


def _aim_error_m(judged: ClassifiedBall, decisions: list[RacketDecision], flown: list[BallTruth]) -> float:
    if not decisions:
        return float("nan")
    expected_m = decisions[-1].state[:3]
    came_m = judged.arrival[:3] if np.isfinite(judged.q_wxyz[0]) else _at_plane(flown, float(expected_m[0]))
    return float(np.linalg.norm(came_m[1:3] - expected_m[1:3]))


def _at_plane(flown: list[BallTruth], x_m: float) -> Array:
    """(3,) where the ball first was at a plane on its way to the robot; NaN if it never came there."""
    ps_m = np.concatenate([part.p_world_m[part.visible] for part in flown])
    passed = np.flatnonzero((ps_m[:-1, 0] > x_m) & (ps_m[1:, 0] <= x_m))
    if not len(passed):
        return np.full(3, np.nan)
    before, after = ps_m[passed[0]], ps_m[passed[0] + 1]
    return before + (x_m - before[0]) / (after[0] - before[0]) * (after - before)
