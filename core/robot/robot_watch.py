"""Connection state of a robot, and whether targets may be sent; updated by the client's thread."""

from __future__ import annotations

import statistics
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from core.config import check_settings, setting
from core.robot.robot_messages import RobotLimits, RobotState, RobotWelcome

SAMPLES: Final = 40
"""Number of clock samples, two seconds: too short for noticeable drift."""
ENOUGH: Final = 3
"""Consistent replies needed before the clock counts as known."""
TOLERANCE_US: Final = 2000.0
"""Tolerance for drift, in addition to the round trips' uncertainty."""


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The robot's clock shows ours plus `offset_us`."""

    offset_us: float
    within_us: float
    """Largest possible error: half the quickest round trip."""

    def robot_us(self, host_us: float) -> int:
        """Robot's clock at a time of our clock."""
        return round(host_us + self.offset_us)

    def host_us(self, robot_us: float) -> float:
        """Our clock at a time of the robot's clock."""
        return robot_us - self.offset_us


class RobotClock:
    """Clock of one robot; used by one thread."""

    def __init__(self) -> None:
        self.jumps = 0
        """Number of clock jumps or inconsistent replies."""
        self._samples: deque[ClockOffset] = deque(maxlen=SAMPLES)

    @property
    def estimate(self) -> ClockOffset | None:
        """Estimate from the quickest recent reply; None while unknown."""
        return min(self._samples, key=lambda one: one.within_us) if len(self._samples) >= ENOUGH else None

    def reset(self) -> None:
        """Forget all samples: it is another clock."""
        self._samples.clear()

    def add(self, sent_us: float, received_us: float, robot_us: float) -> bool:
        """Between these two times of ours its clock showed this; false if it has jumped, and is to be learned anew."""
        within_us = max(0.0, received_us - sent_us) / 2
        sample = ClockOffset(robot_us - (sent_us + received_us) / 2, within_us)
        jumped = any(
            abs(sample.offset_us - one.offset_us) > within_us + one.within_us + TOLERANCE_US for one in self._samples
        )
        if jumped:
            self.jumps += 1
            self._samples.clear()
        self._samples.append(sample)
        return not jumped


Connection = Literal["awaited", "ready", "lost", "slow", "clock"]
"""Not there yet; may be sent to; silent; answers too late; its clock has jumped, or is not known yet."""
ROUND_TRIPS: Final = 5
"""The middle one of the last counts."""
STATES: Final = 2000
ANEW: Final = "its program was started anew: a person has to start it"


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotWatchConfig:
    """When a robot counts as lost, or slow."""

    lost_ms: float = setting(500.0, 20.0, 10_000.0)
    """Time without a message after which it counts as lost; it sends its state about 200 times a second."""
    slow_ms: float = setting(60.0, 1.0, 5_000.0)
    """A round trip, or the age of its newest state: later than that nothing is aimed at a ball."""

    def __post_init__(self) -> None:
        check_settings(self)


@dataclass(frozen=True, slots=True)
class StopNote:
    """A stop: by whom, and why."""

    by: Literal["robot", "rallyscope"]
    reason: str


@dataclass(frozen=True, slots=True)
class RobotCounts:
    """Counts since Rallyscope was started."""

    sent: int = 0
    taken: int = 0
    """Targets that it accepted."""
    refused: int = 0
    """Targets that it refused."""
    unanswered: int = 0
    kept_back: int = 0
    """Targets not sent because they were outside the limits."""
    not_ready: int = 0
    """Targets not sent because the robot was stopped, lost or slow, its clock unknown, or the source not in real
    time."""
    lost: int = 0
    """Times that it was lost."""
    slow: int = 0
    clock_jumps: int = 0
    stops: int = 0
    rejected: int = 0
    """Invalid messages from it."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotStatus:
    """Status of a robot."""

    address: str
    connection: Connection
    problem: str
    """Why no targets are sent; empty if they may be."""
    name: str
    limits: RobotLimits | None
    state: RobotState | None
    """The newest."""
    stop: StopNote | None
    """The stop; None: it plays."""
    round_trip_ms: float | None
    clock: ClockOffset | None
    last_refusal: str
    counts: RobotCounts

    @property
    def ready(self) -> bool:
        """Whether a target may leave now."""
        return self.connection == "ready" and self.stop is None


@dataclass(slots=True)
class RobotWatch:
    """Connection state of one robot. Callers on several threads hold a lock."""

    address: str
    config: RobotWatchConfig = field(default_factory=RobotWatchConfig)
    clock: RobotClock = field(default_factory=RobotClock)
    welcome: RobotWelcome | None = None
    """Its welcome; None while a handshake is needed."""
    stop: StopNote | None = None
    counts: RobotCounts = field(default_factory=RobotCounts)
    last_refusal: str = ""
    barred: str = ""
    """Why the handshake was rejected; empty if it was not."""
    states: deque[RobotState] = field(default_factory=lambda: deque(maxlen=STATES))
    _known: RobotWelcome | None = None
    _received_us: float = 0.0
    _connection: Connection = "awaited"
    _round_trips_us: deque[float] = field(default_factory=lambda: deque(maxlen=ROUND_TRIPS))

    def greet(self, welcome: RobotWelcome, host_us: float) -> None:
        """Handle its welcome; a restarted program has to be started by a person."""
        self._received_us = host_us
        if self._known is None or welcome.session != self._known.session:
            if self._known is not None:
                self.stop = StopNote("robot", ANEW)
            self.clock.reset()
            self._round_trips_us.clear()
            self.states.clear()
        self.welcome = self._known = welcome
        self.barred = ""

    def note_pong(self, sent_us: float, received_us: float, robot_us: int) -> None:
        """Handle the reply to a ping."""
        self._received_us = received_us
        self._round_trips_us.append(received_us - sent_us)
        if not self.clock.add(sent_us, received_us, robot_us):
            self.count(clock_jumps=1)

    def note_state(self, state: RobotState, host_us: float) -> None:
        """Handle its state."""
        known = self.welcome
        if known is None or state.session != known.session:
            return
        self._received_us = host_us
        if self.states and state.t_us < self.states[-1].t_us:
            self.count(clock_jumps=1)
            self.clock.reset()
            self.states.clear()
        self.states.append(state)
        if state.stopped and self.stop is None:
            self.halt(StopNote("robot" if state.stopped == "robot" else "rallyscope", state.reason))

    def halt(self, note: StopNote) -> None:
        """Record a stop."""
        self.stop = note
        self.count(stops=1)

    def look(self, now_us: float) -> Connection:
        """How it is; counts what has become worse. One that is lost has to be greeted again."""
        before, self._connection = self._connection, self._judge(now_us)
        if self._connection != before:
            self.count(lost=self._connection == "lost", slow=self._connection == "slow")
        if self._connection == "lost":
            self.welcome = None
            self.clock.reset()
            self._round_trips_us.clear()
        return self._connection

    def count(self, **more: int) -> None:
        """Add to counts by name."""
        self.counts = replace(self.counts, **{name: getattr(self.counts, name) + one for name, one in more.items()})

    @property
    def state(self) -> RobotState | None:
        """The newest."""
        return self.states[-1] if self.states else None

    def status(self, now_us: float) -> RobotStatus:
        """Frozen status."""
        known = self._known
        round_trip_us = statistics.median(self._round_trips_us) if self._round_trips_us else None
        return RobotStatus(
            self.address, self._connection, self._problem(now_us), "" if known is None else known.name,
            None if known is None else known.limits, self.state, self.stop,
            None if round_trip_us is None else round_trip_us / 1e3, self.clock.estimate, self.last_refusal, self.counts,
        )  # fmt: skip

    def _judge(self, now_us: float) -> Connection:
        if self.welcome is None:
            return "awaited" if self._known is None else "lost"
        if now_us - self._received_us > 1e3 * self.config.lost_ms:
            return "lost"
        clock, state = self.clock.estimate, self.state
        if clock is None or state is None:
            return "clock"
        age_us = now_us - clock.host_us(state.t_us)
        if max(age_us, statistics.median(self._round_trips_us)) > 1e3 * self.config.slow_ms:
            return "slow"
        return "ready"

    def _problem(self, now_us: float) -> str:
        if self.barred and self.welcome is None:
            return self.barred
        match self._connection:
            case "awaited":
                return "nobody has answered yet"
            case "lost":
                return f"lost: nothing heard for {(now_us - self._received_us) / 1e6:.0f} s"
            case "slow":
                return f"slow: its answers and states come later than {self.config.slow_ms:g} ms"
            case "clock":
                return "its clock is being compared with ours"
            case "ready":
                return ""
