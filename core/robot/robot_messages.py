"""Messages between Rallyscope and a robot. See docs/how/robot-link.md.

Like the messages of the simulation link each is one msgpack map {"v": version, "kind": name, ...fields}. Every `t_us`,
`sent_us`, `valid_until_us` and `impact_us` is a time of the robot's own clock, which never runs backwards; `host_us` is
one of Rallyscope's. Places and velocities are in the world's frame, metres and seconds.
"""

# ruff: noqa: RUF009  (a field's bounds declare it, as `dataclasses.field` does)

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from core.errors import LinkError
from core.live.link.fields import WALL_NS, bounded_number, choice, flag, optional, part, text, texts, vector, whole
from core.live.link.messages import decode, encode

ROBOT_MESSAGE_BYTES: Final = 4096
"""Largest message, bytes; the longest that we send has about 400."""
CAMERAS_BYTES: Final = 2048
"""Longest list of camera names, bytes: with it a target still fits into a message."""
TURN_BOUND: Final = 100.0
PARTIES: Final = ("", "robot", "rallyscope")
WHY: Final = (
    "", "not a message", "stranger", "lost", "stopped", "older", "stale", "clock",
    "late", "early", "bounds", "unreachable",
)  # fmt: skip
"""Why something is refused, in a word; "": it is not."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotLimits:
    """Where the middle of the racket's face may be, how it may stand, and how fast it may move."""

    low_m: tuple[float, ...] = vector(3, 5.0)
    high_m: tuple[float, ...] = vector(3, 5.0)
    """Corners of the box that its middle never leaves."""
    max_speed_mps: float = bounded_number(0.01, 20.0)
    max_acceleration_mps2: float = bounded_number(0.1, 500.0)
    max_turn_rate_radps: float = bounded_number(0.01, TURN_BOUND)
    normal: tuple[float, ...] = vector(3, 1.001, default=(1.0, 0.0, 0.0))
    """A unit vector: from it the normal of the face (its x axis) may be turned away by `max_tilt_rad`."""
    max_tilt_rad: float = bounded_number(0.0, math.pi, default=math.radians(60.0))
    max_lead_us: int = whole(1000, 10_000_000, default=2_000_000)
    """Largest lead time of an impact; later impacts are rejected."""

    def __post_init__(self) -> None:
        if not all(low < high for low, high in zip(self.low_m, self.high_m, strict=True)):
            raise LinkError(
                "an empty box", expected="low_m < high_m", got=f"{self.low_m}, {self.high_m}", where="limits"
            )
        if abs(float(np.linalg.norm(self.normal)) - 1) > 1e-3:
            raise LinkError("not a unit vector", got=self.normal, where="limits.normal")


@dataclass(frozen=True, slots=True, kw_only=True)
class HelloRobot:
    """Handshake and request to command the robot."""

    id: int = whole(0, WALL_NS)
    client: str = text(64)
    """Random identifier of this running Rallyscope."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotTarget:
    """Where the middle of the face is to be at the time of the impact, how it stands, and how it moves then."""

    id: int = whole(1, WALL_NS)
    """Its sequence number: grows with every request, so that what is older shows."""
    sent_us: int = whole(0, WALL_NS)
    valid_until_us: int = whole(0, WALL_NS)
    """A robot that has not begun with it by then must not."""
    impact_us: int = whole(0, WALL_NS)
    p_m: tuple[float, ...] = vector(3, 5.0)
    q_wxyz: tuple[float, ...] = vector(4, 1.001)
    v_mps: tuple[float, ...] = vector(3, 20.0)
    turn_radps: tuple[float, ...] | None = optional(vector(3, TURN_BOUND))
    """Angular velocity, where one is wanted."""
    cameras: tuple[str, ...] = texts(CAMERAS_BYTES)
    """Names of the cameras that the newest answer behind this target is made of, sorted; empty for a step of the step
    test, from an older Rallyscope, or if the names are too long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopRobot:
    """Stop, and take no target until somebody has started it again."""

    id: int = whole(1, WALL_NS)
    reason: str = text(200)


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRobot:
    """Start playing, on a person's request."""

    id: int = whole(1, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class PingRobot:
    """Query of its clock, with the current estimate."""

    id: int = whole(1, WALL_NS)
    host_us: int = whole(0, WALL_NS)
    offset_us: float | None = optional(bounded_number(-WALL_NS, WALL_NS))
    """Estimated robot clock minus `host_us`."""
    within_us: float | None = optional(bounded_number(0.0, WALL_NS))
    """Half the round trip of the best answer: the estimate cannot be farther off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotWelcome:
    """The answer to a hello."""

    id: int = whole(0, WALL_NS)
    session: str = text(64)
    """Random number, new at each start of the robot's program."""
    name: str = text(64)
    limits: RobotLimits = part(RobotLimits)
    t_us: int = whole(0, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotAnswer:
    """Reply to a target, a stop or a start, or error of an invalid message."""

    id: int = whole(0, WALL_NS)
    ok: bool = flag()
    why: str = choice(*WHY)
    said: str = text(300)
    """The reason as a readable text."""
    t_us: int = whole(0, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotPong:
    """The answer to a ping."""

    id: int = whole(1, WALL_NS)
    host_us: int = whole(0, WALL_NS)
    t_us: int = whole(0, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotState:
    """Where the racket was at `t_us`, and what the robot is about."""

    session: str = text(64)
    t_us: int = whole(0, WALL_NS)
    p_m: tuple[float, ...] = vector(3, 10.0)
    q_wxyz: tuple[float, ...] = vector(4, 1.001)
    v_mps: tuple[float, ...] = vector(3, 50.0)
    following: int = whole(0, WALL_NS)
    """Number of the target that it follows; 0: none."""
    stopped: str = choice(*PARTIES)
    """Who stopped it; "": it plays."""
    reason: str = text(200)
    """Reason of the stop."""


TO_ROBOT: Final[dict[str, type]] = {
    "robot_hello": HelloRobot,
    "robot_target": RobotTarget,
    "robot_stop": StopRobot,
    "robot_start": StartRobot,
    "robot_ping": PingRobot,
}
FROM_ROBOT: Final[dict[str, type]] = {
    "robot_welcome": RobotWelcome,
    "robot_answer": RobotAnswer,
    "robot_pong": RobotPong,
    "robot_state": RobotState,
}
_NAMES: Final = {kind: name for name, kind in (TO_ROBOT | FROM_ROBOT).items()}


def encode_robot(message: object) -> bytes:
    """The bytes of any message above."""
    return encode(message, _NAMES)


def decode_robot(data: bytes, kinds: dict[str, type]) -> Any:
    """The message in some bytes, which may be anything.

    Raises:
        LinkError: if it is too long, of another version, not of the `kinds`, or breaks a bound.
    """
    return decode(data, kinds, ROBOT_MESSAGE_BYTES)
