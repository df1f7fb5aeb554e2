"""Frozen state of a live player, made once per block by its thread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import BallPoint, ChainState
from core.chain.control.decision import RacketDecision
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
