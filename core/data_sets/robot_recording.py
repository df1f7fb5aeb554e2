"""Simulated recordings in which the robot plays: the built-in controller knows every ball and strikes it.

So the racket is in the pictures, and the recording says where it was, what it was sent to and what came of each ball.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.chain.control.controller import BuiltInController, RacketDecision
from core.chain.control.hit_choice import FaceTrajectory, HitChoiceConfig, RacketReach, choose_hit
from core.chain.control.known_flight import KnownFlight, fly_to_planes
from core.config import config_to_mapping
from core.errors import ConfigError
from core.history.recorded_rally import (
    EPISODES,
    HIT_CHOICES,
    RACKET,
    TARGETS,
    choice_rows,
    episode_rows,
    racket_rows,
    target_rows,
)
from core.live.link.published import outcome_notice
from core.live.worlds.world import Block, ClassifiedBall, SimulatedWorld, WorldConfig
from core.physics.config import PhysicsConfig
from core.physics.episode import Serves
from core.physics.task import HitRule
from core.recordings import RecordingWriter
from core.simulation.episodes.ball_outcome import RallyEvent
from core.simulation.episodes.closed_form import fly_serves
from core.simulation.event_cameras.event_camera import BLOCK_US
from core.simulation.flights import BallStates, VisibleRange
from core.simulation.frames import FrameConfig, FrameTrack
from core.simulation.recording import SimulatedRecording, frames_mapping, write_frames, write_readout
from core.simulation.scenes.racket_view import RacketPoses
from core.trajectory.prediction import Stage

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

FIRST_SERVE_US: Final = 50_000
QUIET_US: Final = 150_000
"""Between the end of one ball and the next serve: the racket goes back to its place."""
LONGEST_BALL_S: Final = 5.0
"""No ball takes longer from the serve to its outcome."""
USUAL_BALL_S: Final = 1.6
"""Usual duration of a ball, s, for the progress bar."""
KEPT_BLOCKS: Final = 8
"""More than the longest exposure of a picture."""


def record_robot(
    path: Path,
    config: WorldConfig,
    cameras: Mapping[str, Camera],
    speeds_mps: Sequence[float],
    *,
    seed: int,
    frames: FrameConfig | None = None,
    threads: int | None = None,
    uuid: str | None = None,
    remarks: Mapping[str, object] | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    hit: HitRule = "paper",
) -> SimulatedRecording:
    """Write a recording of one serve per speed, played by the robot. The same seed gives the same recording.

    Args:
        path: the file.
        config: task, scene, sensor and racket.
        cameras: lens and pose, by name.
        speeds_mps: of the serves, one after the other.
        seed: of serves and noise.
        frames: pictures that are taken too.
        threads: of the cameras; None: one each.
        uuid: identity of the recording; None: a new one.
        remarks: added to its config.
        overwrite: whether a file there may be replaced.
        progress: gets the share that is done.
        hit: where the robot meets balls; as chosen, or always at the paper's plane.

    Raises:
        RecordingError: if the file exists and `overwrite` is not set, or it cannot be written.
        ConfigError: if there is no serve of a speed, or two players have the table.
    """
    if config.stereo.scene.cast == "rally":
        raise ConfigError("two players have the table", expected="another scene, or no robot", where="scene rally")
    settings = {
        **config_to_mapping(config.stereo),
        "task": config_to_mapping(config.task),
        "robot": {"controller": "built-in", "hit": hit, "racket": config_to_mapping(config.racket)},
        "speeds_mps": list(speeds_mps),
        **frames_mapping(frames),
        **(remarks or {}),
    }
    world = SimulatedWorld(config, cameras, seed, threads=threads)
    try:
        sensors = {name: camera.sensor for name, camera in cameras.items()}
        with RecordingWriter(
            path, sensors, calibration=cameras, seed=seed, config=settings, uuid=uuid, overwrite=overwrite
        ) as writer:
            track = None if frames is None else FrameTrack(cameras, config.stereo.scene, frames, seed, world.bodies)
            session = _Session(world, writer, track, hit)
            session.wait(FIRST_SERVE_US)
            for number, speed_mps in enumerate(speeds_mps):
                base = number / len(speeds_mps)
                session.play(speed_mps, lambda share, base=base: progress(base + share / len(speeds_mps)))
            writer.extend_duration(world.now_us)
            write_readout(writer, world.readout)
            counts = {name: writer.event_count(name) for name in cameras}
    finally:
        world.close()
    delayed = {name: counted.delayed for name, counted in world.readout.items()}
    dropped = {name: counted.dropped for name, counted in world.readout.items()}
    return SimulatedRecording(
        path, world.now_us, len(speeds_mps), counts, session.truths, delayed, dropped, session.pictures, True
    )


class _BallToHit(NamedTuple):
    """A ball where it is to be hit."""

    t_s: float
    state: Array
    """(9,) position, velocity, spin."""


class _Session:
    """The robot at play, and the writer beside it."""

    def __init__(self, world: SimulatedWorld, writer: RecordingWriter, track: FrameTrack | None, hit: HitRule) -> None:
        self._world, self._writer, self._track, self._hit = world, writer, track, hit
        self._controller = BuiltInController(world.config.task)
        self._recent = RecentBlocks(world.config.task.physics)
        self.truths = self.pictures = 0

    def play(self, speed_mps: float, progress: Callable[[float], None]) -> None:
        """One ball from its serve until all is at rest again."""
        world = self._world
        serve = world.draw_serve(speed_mps)
        ball = self._ball_to_hit(serve)
        self._aim(ball, "pre")
        decision: RacketDecision | None = None
        played = False
        while not played:
            block = self._advance()
            progress(min(1.0, (world.now_us * 1e-6 - serve.t_s) / USUAL_BALL_S))
            if decision is None and any(contact.event.kind == "bounce" for contact in block.contacts):
                decision = self._aim(ball, "post")
            for judged in block.outcomes:
                self._write_episode(judged, decision)
                played = True
            if world.now_us * 1e-6 > serve.t_s + LONGEST_BALL_S:
                raise ConfigError(
                    "a ball without an outcome", got=f"{LONGEST_BALL_S} s after a {speed_mps:g} m/s serve"
                )
        while world.ball_is_visible:
            self._advance()
        self.wait(QUIET_US)
        progress(1.0)

    def wait(self, duration_us: int) -> None:
        """Let so much time go by."""
        for _ in range(duration_us // BLOCK_US):
            self._advance()

    def _ball_to_hit(self, serve: RallyEvent) -> _BallToHit | None:
        """The ball, which is known, where it is to be hit; None where no stroke returns it."""
        launch = Serves(serve.state[None, :3], serve.state[None, 3:6], serve.state[None, 6:9])
        config = self._world.config
        if self._hit == "paper":
            arrivals = fly_serves(launch, config.task)
            return _BallToHit(serve.t_s + float(arrivals.t_s[0]), arrivals.states[0])
        rules = HitChoiceConfig()
        flight = KnownFlight.of(fly_to_planes(launch, rules.xs_m, config.task), 0, launch_s=serve.t_s)
        racket = FaceTrajectory(serve.t_s, config.racket.home_m, np.zeros(3))
        reach = RacketReach.of_config(config.racket)
        choice = choose_hit(flight, self._controller.strokes(), racket, reach, rules)
        rows = choice_rows(choice, 0)
        if rows is not None:
            self._writer.append_rows(HIT_CHOICES, rows)
        if choice.chosen is None:
            logger.info("%s", choice.explanation)
            return None
        hit = choice.chosen.hit
        assert hit.spin_radps is not None  # it is known
        return _BallToHit(hit.t_s, np.concatenate([hit.p_world_m, hit.v_world_mps, hit.spin_radps]))

    def _aim(self, ball: _BallToHit | None, stage: Stage) -> RacketDecision | None:
        """Send the racket to where the ball will come; None if no stroke answers it."""
        if ball is None:
            return None
        p, v, spin = np.split(ball.state, 3)
        decision = self._controller.decide(ball.t_s, p, v, stage=stage, spin_radps=spin)
        if decision is None:
            return None
        try:
            self._world.aim(decision.target)
        except ConfigError as error:
            logger.info("racket target refused: %s", error)
            return None
        decision = replace(decision, t_us=self._world.now_us)
        self._writer.append_rows(TARGETS, target_rows(decision, 0))
        return decision

    def _advance(self) -> Block:
        block = self._world.advance()
        for name, events in block.events.items():
            self._writer.append(name, events)
            self._writer.write_truth(name, block.circles[name])
            self.truths += int(block.circles[name].visible.sum())
        self._writer.write_ball(block.ball)
        self._writer.append_rows(RACKET, racket_rows(block, 0))
        self._recent.add(block)
        self.pictures += write_frames(self._writer, self._track, block.end_us, self._recent, self._recent.racket)
        return block

    def _write_episode(self, judged: ClassifiedBall, decision: RacketDecision | None) -> None:
        notice = outcome_notice(judged, "recording", 0)
        self._writer.append_rows(EPISODES, episode_rows(notice, decision, self._controller.name, 0))


class RecentBlocks:
    """Ball and racket over the newest blocks, for pictures whose exposure began in an earlier one."""

    def __init__(self, physics: PhysicsConfig) -> None:
        self._blocks: deque[Block] = deque(maxlen=KEPT_BLOCKS)
        self.racket = RecentRacket(self._blocks, physics)

    def add(self, block: Block) -> None:
        """The next one."""
        self._blocks.append(block)

    @property
    def end_s(self) -> float:
        """End of the newest block, s."""
        return self._blocks[-1].end_us * 1e-6

    @property
    def discontinuities_s(self) -> Array:
        """Ascending."""
        return np.concatenate([block.path.discontinuities_s for block in self._blocks])

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at times (N,) in the kept blocks."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        p, v, spin = np.full((3, len(t), 3), np.nan)
        present = np.zeros(len(t), np.bool_)
        for block, inside in _by_block(self._blocks, t):
            states = block.path.at(t[inside])
            p[inside], v[inside], spin[inside] = states.p_world_m, states.v_world_mps, states.spin_radps
            present[inside] = states.present
        return BallStates(t, p, v, spin, present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """What hides the ball at times (N,)."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        normal, offset = np.zeros((len(t), 3)), np.full(len(t), -np.inf)
        for block, inside in _by_block(self._blocks, t):
            visible_range = block.path.visible_range(t[inside])
            normal[inside], offset[inside] = visible_range.normal_world, visible_range.offset_m
        return VisibleRange(normal, offset)


class RecentRacket:
    """The racket over the same blocks."""

    def __init__(self, blocks: deque[Block], physics: PhysicsConfig) -> None:
        self._blocks = blocks
        self.radius_m, self.thickness_m = physics.racket_radius_m, physics.racket_thickness_m

    def at(self, t_s: ArrayLike) -> RacketPoses:
        """The racket at times (N,) in the kept blocks."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        p, normal = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        for block, inside in _by_block(self._blocks, t):
            poses = block.racket_path.at(t[inside])
            p[inside], normal[inside] = poses.p_world_m, poses.normal_world
        return RacketPoses(p, normal)


def _by_block(blocks: deque[Block], t_s: Array) -> list[tuple[Block, NDArray[np.bool_]]]:
    """Each block that a time belongs to, with those times; what is before or after all belongs to the nearest."""
    which = np.floor((t_s * 1e6 - blocks[0].start_us) / BLOCK_US + 1e-9)
    which = np.clip(which, 0, len(blocks) - 1).astype(np.intp)
    return [(blocks[index], which == index) for index in np.unique(which)]
