"""The simulated world of one session, block by block: rally, outcome classifier, event cameras and truth.

Paths of ball and racket over one block, from the rally's steps and impacts, for the event cameras.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.config import check_settings, setting
from core.events import Events
from core.extras import require_package
from core.jit import njit
from core.physics import TaskConfig
from core.physics.rotation import normals_from_orientations
from core.recordings import BallTruth, PixelTruth
from core.simulation import StereoConfig, ball_truth, pixel_truths, truth_times
from core.simulation.bodies import MovingBodies, make_actors
from core.simulation.episodes import draw_serves
from core.simulation.episodes.ball_outcome import BallOutcome, RallyClassifier, RallyEvent
from core.simulation.episodes.incoming import RecordedServes
from core.simulation.episodes.racket import RacketConfig, RacketTarget, check_target
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights import BallStates, VisibleRange
from core.simulation.scenes.racket_view import RacketPoses
from core.simulation.scenes.scene import SceneConfig
from core.simulation.sensor.readout import ReadoutCounts
from core.simulation.sensor.sensor import SensorConfig
from core.table import BALL_RADIUS_M

Array = NDArray[np.float64]

SINK_S: Final = 0.04
"""A ball that is out of play disappears downwards in this time: at once would be a flash of events."""
MOUTH_M: Final = 3 * BALL_RADIUS_M
"""A served ball comes out of a launcher's mouth, which hides it until it has flown this far."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledRacket:
    """Cubic pieces between samples of the racket: its path is one in a step, unless its law changes within."""

    t_s: Array
    """(M,) ascending."""
    ps_m: Array
    """(M, 3) middle of the face."""
    vs_mps: Array
    """(M, 3)."""
    normals: Array
    """(M, 3)."""
    radius_m: float
    thickness_m: float

    def at(self, t_s: ArrayLike) -> RacketPoses:
        """The racket at times (N,); beyond the samples it is where the nearest one says."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        p, n = np.empty((len(t), 3)), np.empty((len(t), 3))
        _racket_at(self.t_s, self.ps_m, self.vs_mps, self.normals, t, p, n)
        return RacketPoses(p, n)


@njit(error_model="numpy")
def _racket_at(t_s, ps, vs, normals, times_s, p, n):
    for index in range(len(times_s)):
        which = min(max(np.searchsorted(t_s, times_s[index], side="right") - 1, 0), len(t_s) - 2)
        h = t_s[which + 1] - t_s[which]
        s = min(max((times_s[index] - t_s[which]) / h, 0.0), 1.0)
        length2 = 0.0
        for axis in range(3):
            start, v0, v1 = ps[which, axis], vs[which, axis] * h, vs[which + 1, axis] * h
            step = ps[which + 1, axis] - start
            p[index, axis] = start + s * (v0 + s * (3 * step - 2 * v0 - v1 + s * (v0 + v1 - 2 * step)))
            # It turns by less than 3 degrees in a step.
            n[index, axis] = (1 - s) * normals[which, axis] + s * normals[which + 1, axis]
            length2 += n[index, axis] * n[index, axis]
        for axis in range(3):
            n[index, axis] /= math.sqrt(length2)


class SampledPath:
    """Cubic pieces between samples, with a jump of velocity at impacts. Exact for a parabola."""

    def __init__(self, start_s: float) -> None:
        self._starts: list[tuple[float, Array]] = []
        self._ends: list[tuple[float, Array]] = []
        self._pieces: tuple[Array, Array] | None = None
        self._discontinuities_s: list[float] = []
        self.end_s = start_s
        self.launch: tuple[float, Array] | None = None
        """Time and state (9,) of the serve that is being seen."""
        self.gone_s: float | None = None
        """When the ball went out of play."""

    def add(self, start_s: float, start: Array, end_s: float, end: Array) -> None:
        """The ball went from one state (9,) to another; pieces come in order.

        Args:
            start_s: time of the first state.
            start: (9,) position, velocity and spin.
            end_s: time of the second.
            end: (9,).
        """
        if end_s > start_s:
            self._starts.append((start_s, start))
            self._ends.append((end_s, end))
            self._pieces = None
            self.end_s = end_s

    def kink(self, t_s: float) -> None:
        """Add a discontinuity: the velocity jumps, or the ball appears or vanishes."""
        self._discontinuities_s.append(t_s)

    @property
    def discontinuities_s(self) -> Array:
        """Ascending."""
        return np.unique(np.array(self._discontinuities_s, np.float64))

    def at(self, t_s: ArrayLike) -> BallStates:
        """The ball at times (N,); after the last sample it is where that says."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        if not self._starts:
            nothing = np.full((len(t), 3), np.nan)
            return BallStates(t, nothing, nothing, nothing, np.zeros(len(t), np.bool_))
        if self._pieces is None:
            sides = list(zip(self._starts, self._ends, strict=True))
            self._pieces = np.array([(a[0], b[0]) for a, b in sides]), np.array([(a[1], b[1]) for a, b in sides])
        vanished_s = math.inf if self.gone_s is None else self.gone_s + SINK_S
        (p, v, spin), present = np.empty((3, len(t), 3)), np.empty(len(t), np.bool_)
        _ball_at(*self._pieces, vanished_s, t, (p, v, spin), present)
        return BallStates(t, p, v, spin, present)

    def visible_range(self, t_s: ArrayLike) -> VisibleRange:
        """The launcher's mouth just after a serve; the rising floor of a ball that is out of play."""
        t = np.atleast_1d(np.asarray(t_s, np.float64))
        normal, offset = np.zeros((len(t), 3)), np.full(len(t), -np.inf)
        if self.launch is not None:
            start_s, state = self.launch
            speed = float(np.linalg.norm(state[3:6]))
            if speed > 0:
                near = (t >= start_s) & ((t - start_s) * speed < MOUTH_M)
                normal[near] = state[3:6] / speed
                offset[near] = normal[near] @ state[:3] + BALL_RADIUS_M
        if self.gone_s is not None and self._ends:
            sinking = t >= self.gone_s
            share = (t[sinking] - self.gone_s) / SINK_S
            normal[sinking] = (0.0, 0.0, 1.0)
            offset[sinking] = self._ends[-1][1][2] + BALL_RADIUS_M * (2 * share - 1)
        return VisibleRange(normal, offset)


@njit(error_model="numpy")
def _ball_at(pieces_s, states, vanished_s, times_s, found, present):
    p, v, spin = found
    for index in range(len(times_s)):
        t = times_s[index]
        present[index] = pieces_s[0, 0] <= t < vanished_s
        if not present[index]:
            p[index] = v[index] = spin[index] = math.nan
            continue
        which = max(np.searchsorted(pieces_s[:, 0], t, side="right") - 1, 0)
        start_s, end_s = pieces_s[which]
        h = end_s - start_s
        s = min(max((t - start_s) / h, 0.0), 1.0)
        a, b = states[which]
        for axis in range(3):
            step, v0, v1 = b[axis] - a[axis], a[3 + axis] * h, b[3 + axis] * h
            square, cube = 3 * step - 2 * v0 - v1, v0 + v1 - 2 * step
            p[index, axis] = a[axis] + s * (v0 + s * (square + s * cube))
            v[index, axis] = (v0 + s * (2 * square + 3 * s * cube)) / h
            spin[index, axis] = a[6 + axis]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldConfig:
    """Settings of the simulated world."""

    task: TaskConfig = field(default_factory=TaskConfig)
    racket: RacketConfig = field(default_factory=RacketConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    step_ms: float = setting(2.0, 0.1, 10.0)
    """Step of the physics. Impacts are exact at any step; this is how often the racket's path is sampled."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True, eq=False)
class ClassifiedBall:
    """An outcome with the states before it."""

    outcome: BallOutcome
    serve: RallyEvent
    arrival: Array
    """(6,) position and velocity at the racket, or without a hit at the hitting plane; NaN if it came to neither."""
    q_wxyz: Array
    """(4,) of the racket at the hit, NaN without one."""


@dataclass(frozen=True, slots=True, eq=False)
class RacketContact:
    """A bounce on the table or a hit of the racket."""

    event: RallyEvent
    q_wxyz: Array
    """(4,) of the racket then."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Everything that happened in [start_us, end_us)."""

    start_us: int
    end_us: int
    events: dict[str, Events]
    circles: dict[str, PixelTruth]
    ball: BallTruth
    racket_t_us: NDArray[np.int64]
    racket: Array
    """(M, 10) position, orientation wxyz, velocity."""
    contacts: tuple[RacketContact, ...]
    """Bounces on the table and hits of the racket, in order."""
    outcomes: tuple[ClassifiedBall, ...]
    path: SampledPath
    """The ball at any time in it."""
    racket_path: SampledRacket


class SimulatedWorld:
    """Advances in whole blocks. One thread at a time."""

    def __init__(
        self,
        config: WorldConfig,
        cameras: Mapping[str, Camera],
        seed: int,
        *,
        threads: int | None = None,
        recorded: RecordedServes | None = None,
    ) -> None:
        """The cameras work in so many threads, the caller's among them; one each unless told otherwise.

        With `recorded`, serves are of those.
        """
        self.config = config
        self._recorded = recorded
        self.seed = seed
        require_package("mujoco", "the simulated rally")
        from core.simulation.episodes.mujoco_rally import MujocoRally  # late: MuJoCo may not be installed

        self.rally = MujocoRally(config.task, config.racket, dt_s=config.step_ms * 1e-3)
        self._judge = RallyClassifier(config.task)
        self._rng, *camera_rngs = (
            np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(len(cameras) + 1)
        )
        self._workers = threads or len(cameras)
        self._pool = ThreadPoolExecutor(self._workers, thread_name_prefix="event-camera")  # the kernels release the GIL
        self._cameras = dict(cameras)
        self._lost = dict.fromkeys(cameras, ReadoutCounts())
        self._look_at(config.stereo.scene, config.stereo.sensor, camera_rngs, 0)
        self.now_us = 0
        self.struck = self.pending = False
        self.gone_s: float | None = None
        self._launch: RallyEvent | None = None
        self._new_launch = False
        self._arrival, self._q_hit = np.full(6, np.nan), np.full(4, np.nan)
        self._unreported: list[ClassifiedBall] = []
        self._contacts: list[RacketContact] = []
        self._on_their_way: list[tuple[float, RacketTarget | None]] = []

    def serve(self, p_m: ArrayLike, v_mps: ArrayLike, spin_radps: ArrayLike) -> RallyEvent:
        """Serve a ball now; one still in play counts as missed.

        Raises:
            ConfigError: if it is no possible serve.
        """
        event = self.rally.serve(p_m, v_mps, spin_radps)
        self._unreported += self._judged([event])
        self._launch, self._new_launch, self.gone_s = event, True, None
        self.pending, self.struck = True, False
        self._arrival, self._q_hit = np.full(6, np.nan), np.full(4, np.nan)
        return event

    def draw_serve(self, speed_mps: float) -> RallyEvent:
        """Serve a ball drawn for a speed; with recorded ones, of about that speed where it was recorded.

        Raises:
            ConfigError: if there is no legal serve of that speed.
        """
        if self._recorded is not None:
            drawn = self._recorded.draw(speed_mps, self._rng)
        else:
            drawn = draw_serves(speed_mps, 1, self.config.task, self._rng)
        return self.serve(drawn.ps_m[0], drawn.vs_mps[0], drawn.spins_radps[0])

    def aim(self, target: RacketTarget | None, *, after_s: float = 0.0) -> None:
        """Send the racket to a target, or to rest; it takes effect after the command latency, at a physics step.

        Raises:
            ConfigError: if it is out of bounds.
        """
        if after_s <= 0:
            self.rally.aim_racket(target)
            return
        if target is not None:
            check_target(target, self.config.racket)
        self._on_their_way.append((self.now_us * 1e-6 + after_s, target))
        self._on_their_way.sort(key=lambda one: one[0])

    def set_noise(self, noise_hz: float) -> None:
        """Set the noise rate of all cameras, Hz per pixel."""
        for eye in self._eyes.values():
            eye.set_noise(noise_hz)

    def set_scene(self, scene: SceneConfig) -> None:
        """Change the cameras' scene; their pixel states are reset. Takes a moment."""
        self._lost = self.readout
        rngs = [
            np.random.default_rng(s) for s in np.random.SeedSequence([self.seed, self.now_us]).spawn(len(self._eyes))
        ]
        sensor = next(iter(self._eyes.values())).config
        self._look_at(scene, sensor, rngs, self.now_us)

    def _look_at(
        self, scene: SceneConfig, sensor: SensorConfig, rngs: Sequence[np.random.Generator], start_us: int
    ) -> None:
        self._bodies = make_actors(scene.cast, self.seed)
        bodies = self._bodies
        made = self._pool.map(
            lambda camera, rng: EventCamera(camera, scene, sensor, rng, bodies, start_us), self._cameras.values(), rngs
        )
        self._eyes = dict(zip(self._cameras, made, strict=True))

    @property
    def ball_is_visible(self) -> bool:
        """Whether a ball is in play, or still disappearing."""
        now = self.now_us * 1e-6
        return self._launch is not None and (self.gone_s is None or now < self.gone_s + SINK_S)

    @property
    def readout(self) -> dict[str, ReadoutCounts]:
        """Counts of each camera's readout since the start."""
        return {name: self._lost[name].plus(eye.readout_counts) for name, eye in self._eyes.items()}

    @property
    def bodies(self) -> MovingBodies | None:
        """Bodies that move besides ball and racket."""
        return self._bodies

    def advance(self) -> Block:
        """Simulate the next block."""
        start_us, end_us = self.now_us, self.now_us + BLOCK_US
        self._contacts = []
        path, rows, outcomes = self._advance_rally(start_us, end_us)
        normals, physics = normals_from_orientations(rows[:, 4:8]), self.config.task.physics
        radius_m, thickness_m = physics.racket_radius_m, physics.racket_thickness_m
        racket = SampledRacket(rows[:, 0], rows[:, 1:4], rows[:, 8:11], normals, radius_m, thickness_m)
        here = len(self._eyes) if self._workers == 1 else 1  # this thread works too instead of waiting
        away = list(self._eyes.items())[here:]
        running = {name: self._pool.submit(eye.advance, path, end_us, racket) for name, eye in away}
        times_us = truth_times(path, start_us, end_us)
        cameras = {name: eye.camera for name, eye in self._eyes.items()}
        circles = pixel_truths(cameras, path, times_us, self._bodies, racket)
        ball = ball_truth(path, times_us)
        events = {
            name: running[name].result() if name in running else eye.advance(path, end_us, racket)
            for name, eye in self._eyes.items()
        }
        self.now_us = end_us
        racket_t_us = np.round(rows[:-1, 0] * 1e6).astype(np.int64)
        return Block(
            start_us,
            end_us,
            events,
            circles,
            ball,
            racket_t_us,
            rows[:-1, 1:],
            tuple(self._contacts),
            outcomes,
            path,
            racket,
        )

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _advance_rally(self, start_us: int, end_us: int) -> tuple[SampledPath, Array, tuple[ClassifiedBall, ...]]:
        path = SampledPath(start_us * 1e-6)
        path.gone_s = self.gone_s
        if self._launch is not None:
            path.launch = (self._launch.t_s, self._launch.state)
        if self._new_launch:
            path.kink(start_us * 1e-6)
            self._new_launch = False
        outcomes, self._unreported = self._unreported, []
        steps = math.ceil(BLOCK_US * 1e-3 / self.config.step_ms)
        edges_s = np.linspace(start_us, end_us, steps + 1) * 1e-6
        rows = [self._racket_row(float(edges_s[0]))]
        for begin_s, end_s in itertools.pairwise(edges_s):
            while self._on_their_way and self._on_their_way[0][0] <= begin_s + 1e-9:
                self.rally.aim_racket(self._on_their_way.pop(0)[1])
            outcomes += self._step(path, float(begin_s), float(end_s))
            rows.append(self._racket_row(float(end_s)))
        return path, np.array(rows), tuple(outcomes)

    def _racket_row(self, t_s: float) -> Array:
        racket = self.rally.racket
        return np.concatenate([[t_s], racket.p_m, racket.q_wxyz, racket.v_mps])

    def _step(self, path: SampledPath, begin_s: float, end_s: float) -> list[ClassifiedBall]:
        visible = self._launch is not None and (self.gone_s is None or begin_s < self.gone_s + SINK_S)
        at_s, state = begin_s, self.rally.ball
        happened = self.rally.step(end_s - self.rally.time_s)
        for event in happened:
            self._note_contact(event)
            if event.state is event.touched:
                continue
            path.add(at_s, state, event.t_s, event.touched)
            path.kink(event.t_s)
            at_s, state = event.t_s, event.state
        if visible:
            path.add(at_s, state, end_s, self.rally.ball)
        if not self.rally.playing and self._launch is not None and self.gone_s is None:
            self.gone_s = path.gone_s = at_s
        return self._judged(happened)

    def _note_contact(self, event: RallyEvent) -> None:
        if event.kind in ("bounce", "hit"):
            self._contacts.append(RacketContact(event, self.rally.racket.q_wxyz.copy()))
        if event.kind == "hit_plane" and np.isnan(self._arrival[0]):
            self._arrival = event.touched[:6].copy()
        if event.kind == "hit" and not self.struck:
            self.struck = True
            self._arrival = event.touched[:6].copy()  # a ball that is met behind the plane has passed it before
            self._q_hit = self.rally.racket.q_wxyz.copy()

    def _judged(self, happened: Sequence[RallyEvent]) -> list[ClassifiedBall]:
        found = []
        for outcome in self._judge.feed(happened):
            assert self._launch is not None
            found.append(ClassifiedBall(outcome, self._launch, self._arrival, self._q_hit))
            self.pending = False
        return found
