"""Frozen state of a live player, made once per block by its thread, and its performance: steps per second, share of a
core, latencies.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import BallPoint, ChainState
from core.chain.control.controller import RacketDecision
from core.chain.control.player import PlayerState
from core.physics.episode import Case
from core.trajectory import Prediction
from core.trajectory.learned_constants import LearnedConstants

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RacketPose:
    """The racket's actual pose: origin in the middle of its face, x axis along the normal."""

    t_us: int
    p_world_m: Array
    q_world_wxyz: Array
    v_world_mps: Array


@dataclass(frozen=True, slots=True, eq=False)
class TrueBall:
    """True state of the simulated ball."""

    t_us: int
    p_world_m: Array
    v_world_mps: Array
    spin_radps: Array


@dataclass(frozen=True, slots=True, eq=False)
class FinishedBall:
    """A ball whose outcome is known."""

    t_us: int
    serve_us: int
    speed_mps: float
    """Speed of the serve, m/s."""
    case: Case
    landing_m: Array
    """(2,) where it came down to the table's plane; NaN if it did not."""
    goal_m: Array
    """(2,) landing target."""
    net_z_m: float
    decision: RacketDecision | None
    """Last decision sent for it; None if there was none."""

    @property
    def returned(self) -> bool:
        """Whether it landed on the opponent's half first."""
        return self.case == Case.RETURNED

    @property
    def error_m(self) -> float:
        """Distance from the landing to the goal; NaN without a landing."""
        return float(np.linalg.norm(self.landing_m - self.goal_m))


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Percentiles of the last few hundred values, ms; NaN before the first."""

    p50_ms: float
    p99_ms: float


STAGES: Final = ("window", "queue", "decode", "detect", "stereo", "filter", "solve", "send", "robot")
"""The way of a command, in its order: from the end of its window to the arrival of its block (the rest of the block,
and the link), waiting for the player (earlier windows of the block among it), events from the message, detectors of all
cameras, triangulation, filter and prediction, controller, waiting in the thread that sends (before it for later windows
of the block that decided nothing, then for the answer to the command before), the robot's answer."""


@dataclass(frozen=True, slots=True)
class StageLatency:
    """How long a stage took, over the last few hundred commands, ms."""

    name: str
    p50_ms: float
    p99_ms: float
    worst_ms: float


@dataclass(frozen=True, slots=True)
class PlayerHealth:
    """Performance of the player, over the last two seconds unless stated otherwise."""

    state_hz: float
    """Steps of the chain per second of wall time."""
    core_share: float
    """Share of one core that the player's thread takes."""
    step: Percentiles
    """Computing of one step: chain and controller."""
    arrival_to_sent: Percentiles
    """From the arrival of a block to the sending of a command that it led to."""
    window_to_sent: Percentiles
    """Latency from the end of the simulated window, so with the wait for the end of its block and the link."""
    commands_sent: int
    """Commands sent in this session."""
    last_refusal: str
    """Empty if there was none."""
    blocks: int
    """Number of blocks processed."""
    blocks_dropped: int
    """Blocks dropped because the player was too slow, or lost in transit."""
    stages: tuple[StageLatency, ...] = ()
    """Where the time of commands went: each of `STAGES`; empty before the first command."""
    pictures: int = 0
    """Pictures of frame cameras that were looked at."""
    pictures_skipped: int = 0
    """Pictures that were not, as events were waiting, or would have been."""


@dataclass(frozen=True, slots=True, eq=False)
class RallySnapshot:
    """State of the rally at the end of one block."""

    number: int
    """Grows with every snapshot; 0 is the empty one."""
    session: str
    t_us: int
    """Simulated time up to which everything is known."""
    controller: str
    """Name of the controller that plays."""
    playing: bool
    """Whether commands are sent; otherwise the player only watches."""
    goal_m: Array
    """(2,) current landing target."""
    state: PlayerState | None
    """After the newest step."""
    points: tuple[BallPoint, ...]
    """Triangulated balls of the last seconds, oldest first."""
    newest: Prediction | None
    """Newest prediction of this flight."""
    racket: RacketPose | None
    ball: TrueBall | None
    """None while there is no ball."""
    phase: str
    """idle, serve, return or decided, as reported by the simulation."""
    finished: tuple[FinishedBall, ...]
    """The last 500 balls, oldest first."""
    played: int
    """Balls of this session that were judged while the player was there."""
    returned: int
    health: PlayerHealth
    problem: str
    """Why there is no chain; empty if there is one."""
    learned: LearnedConstants | None
    """Constants of air and table learned from the balls so far; None for a chain that does not learn."""

    @property
    def chain(self) -> ChainState | None:
        """Chain state of the newest step."""
        return None if self.state is None else self.state.chain


SPAN_S: Final = 2.0
EVERY_S: Final = 0.25
"""Percentiles are computed so often."""
SAMPLES: Final = 500
NOTHING: Final = Percentiles(float("nan"), float("nan"))
NO_HEALTH: Final = PlayerHealth(0.0, 0.0, NOTHING, NOTHING, NOTHING, 0, "", 0, 0)


def percentiles(values_ms: deque[float]) -> Percentiles:
    """Median and 99th percentile."""
    if not values_ms:
        return NOTHING
    p50, p99 = np.percentile(list(values_ms), (50, 99))
    return Percentiles(float(p50), float(p99))


def stage_latencies(commands: Sequence[Sequence[float]]) -> tuple[StageLatency, ...]:
    """Percentiles of each of `STAGES` over commands, each a duration in ms for every stage; nan counts as unknown."""
    found: list[StageLatency] = []
    for name, column in zip(STAGES, np.array(commands, np.float64).reshape(-1, len(STAGES)).T, strict=True):
        known = column[np.isfinite(column)]
        if len(known):
            p50, p99 = np.percentile(known, (50, 99)).tolist()
            found.append(StageLatency(name, p50, p99, float(known.max())))
    return tuple(found)


class LiveMeter:
    """Counters, each written by one thread; slightly late reads are harmless."""

    def __init__(self) -> None:
        self._step_ms: deque[float] = deque(maxlen=SAMPLES)
        self.arrival_to_sent_ms: deque[float] = deque(maxlen=SAMPLES)
        self.window_to_sent_ms: deque[float] = deque(maxlen=SAMPLES)
        self.command_stages_ms: deque[tuple[float, ...]] = deque(maxlen=SAMPLES)
        """A duration for each of `STAGES`, of each command that the robot took."""
        self.sent = self.blocks = self.dropped = 0
        self.pictures = self.pictures_skipped = 0
        self.last_refusal = ""
        self._steps = 0
        self._marks: deque[tuple[float, float, int]] = deque()
        self._made_s = 0.0
        self._health = NO_HEALTH

    def note_step(self, seconds: float) -> None:
        """A step of chain and controller took so long."""
        self._steps += 1
        self._step_ms.append(1e3 * seconds)

    def note_pictures(self, count: int, *, looked_at: bool) -> None:
        """So many pictures came, and the chain looked at them or not."""
        self.pictures += count if looked_at else 0
        self.pictures_skipped += 0 if looked_at else count

    def note_block(self) -> None:
        """A block was played."""
        self.blocks += 1

    def resume(self) -> None:
        """Leave a pause that ends out of the rates."""
        self._marks.clear()

    def health(self) -> PlayerHealth:
        """The figures; called by the player's own thread, whose time on the processor it takes."""
        now_s = time.monotonic()
        if now_s - self._made_s < EVERY_S:
            return self._health
        self._made_s = now_s
        self._marks.append((now_s, time.thread_time(), self._steps))
        while len(self._marks) > 2 and now_s - self._marks[1][0] > SPAN_S:
            self._marks.popleft()
        then, last = self._marks[0], self._marks[-1]
        wall_s = max(last[0] - then[0], 1e-9)
        known = len(self._marks) > 1
        self._health = PlayerHealth(
            state_hz=(last[2] - then[2]) / wall_s if known else 0.0,
            core_share=(last[1] - then[1]) / wall_s if known else 0.0,
            step=percentiles(self._step_ms),
            arrival_to_sent=percentiles(self.arrival_to_sent_ms.copy()),
            window_to_sent=percentiles(self.window_to_sent_ms.copy()),
            commands_sent=self.sent,
            last_refusal=self.last_refusal,
            blocks=self.blocks,
            blocks_dropped=self.dropped,
            stages=stage_latencies(self.command_stages_ms.copy()),
            pictures=self.pictures,
            pictures_skipped=self.pictures_skipped,
        )
        return self._health
