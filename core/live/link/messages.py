"""Messages of the simulation link. See docs/how/simulation-link.md.

A message is one msgpack map {"v": version, "kind": name, ...fields}. Times are microseconds of the simulated clock of a
session; a new session starts at 0. What the server publishes carries a `seq` that grows by one, so that losses show.
"""

# ruff: noqa: RUF009  (`column` declares a field, as `dataclasses.field` does)

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.distortion import COEFFICIENTS, LensModel
from core.errors import EventsError, LinkError, RallyscopeError
from core.events import Events, SensorSize
from core.live.link.fields import (
    COMMAND_BYTES,
    LONGEST_US,
    MAX_EVENTS,
    MAX_ROWS,
    MESSAGE_BYTES,
    WALL_NS,
    bounded_number,
    choice,
    column,
    flag,
    listing,
    numbered,
    optional,
    read_fields,
    settings,
    text,
    vector,
    whole,
    write_fields,
)
from core.live.link.picture import PictureMessage
from core.physics.config import PhysicsConfig
from core.physics.episode import Case
from core.recordings import BallTruth, PixelTruth
from core.simulation.scenes.scene import SCENES


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello:
    """Handshake."""

    id: int = whole(0, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Serve:
    """Serve a ball: drawn for a speed, or with a given state. A ball still in play is removed."""

    id: int = whole(0, WALL_NS)
    speed_mps: float = bounded_number(3.0, 9.0, default=5.0)
    p_m: tuple[float, ...] | None = optional(vector(3, 5.0))
    v_mps: tuple[float, ...] | None = optional(vector(3, 40.0))
    spin_radps: tuple[float, ...] | None = optional(vector(3, 1500.0))

    def __post_init__(self) -> None:
        if (self.p_m is None) != (self.v_mps is None):
            raise LinkError("a launch needs both p_m and v_mps", where="serve")


@dataclass(frozen=True, slots=True, kw_only=True)
class AimRacket:
    """Send the middle of the racket's face to a place, with a velocity, at a time; it keeps its own limits."""

    id: int = whole(0, WALL_NS)
    p_m: tuple[float, ...] = vector(3, 5.0)
    q_wxyz: tuple[float, ...] = vector(4, 1.001)
    v_mps: tuple[float, ...] = vector(3, 20.0)
    t_us: int = whole(0, LONGEST_US)


@dataclass(frozen=True, slots=True, kw_only=True)
class RestRacket:
    """Send the racket back to rest."""

    id: int = whole(0, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pause:
    """Stop the simulated clock."""

    id: int = whole(0, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Resume:
    """Let the clock run."""

    id: int = whole(0, WALL_NS)


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleStep:
    """Run some blocks, then pause."""

    id: int = whole(0, WALL_NS)
    blocks: int = whole(1, 1000, default=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetSpeed:
    """Simulated seconds per second: below 1 is slow motion."""

    id: int = whole(0, WALL_NS)
    factor: float = bounded_number(0.001, 100.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetNoise:
    """Background events per pixel and second."""

    id: int = whole(0, WALL_NS)
    noise_hz: float = bounded_number(0.0, 20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SetScene:
    """Scene of the cameras, from the next block on."""

    id: int = whole(0, WALL_NS)
    scene: str = choice(*SCENES)


@dataclass(frozen=True, slots=True, kw_only=True)
class AutoServe:
    """Serve repeatedly at a speed of 3 to 9 m/s; 0 stops."""

    id: int = whole(0, WALL_NS)
    speed_mps: float = bounded_number(0.0, 9.0)

    def __post_init__(self) -> None:
        if 0 < self.speed_mps < 3:
            raise LinkError("no such serve", expected="3 to 9 m/s, or 0", got=self.speed_mps, where="auto_serve")


@dataclass(frozen=True, slots=True, kw_only=True)
class Reset:
    """Begin a new session at time 0; without a seed the same one again, and so the same serves and events."""

    id: int = whole(0, WALL_NS)
    seed: int | None = optional(whole(0, WALL_NS))


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeNotice:
    """A ball was served."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    t_us: int = whole(0, LONGEST_US)
    speed_mps: float = bounded_number(0.0, 100.0)
    p_m: tuple[float, ...] = vector(3, 100.0)
    v_mps: tuple[float, ...] = vector(3, 100.0)
    spin_radps: tuple[float, ...] = vector(3, 2000.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class OutcomeNotice:
    """Outcome of a served ball."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    t_us: int = whole(0, LONGEST_US)
    serve_us: int = whole(0, LONGEST_US)
    speed_mps: float = bounded_number(0.0, 100.0)
    case: Case = numbered(Case)
    arrival: tuple[float, ...] = vector(6, 1000.0, nan=True)
    """Position and velocity of the ball at the hitting plane or the racket, whichever it met first."""
    q_wxyz: tuple[float, ...] = vector(4, 1.001, nan=True)
    """Orientation of the racket at the impact."""
    landing_m: tuple[float, ...] = vector(3, 1000.0, nan=True)
    landing_v_mps: tuple[float, ...] = vector(3, 1000.0, nan=True)
    net_z_m: float = bounded_number(-1000.0, 1000.0, nan=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class BounceNotice:
    """The ball touched the table."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    t_us: int = whole(0, LONGEST_US)
    """To the nearest microsecond."""
    p_m: tuple[float, ...] = vector(3, 100.0)
    """Position of the ball's centre."""
    v_mps: tuple[float, ...] = vector(3, 1000.0)
    """Just after it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HitNotice:
    """The racket hit the ball."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    t_us: int = whole(0, LONGEST_US)
    p_m: tuple[float, ...] = vector(3, 100.0)
    """Position of the ball's centre."""
    v_mps: tuple[float, ...] = vector(3, 1000.0)
    """Just after it."""
    v_before_mps: tuple[float, ...] = vector(3, 1000.0)
    q_wxyz: tuple[float, ...] = vector(4, 1.001)
    """Orientation of the racket."""


Notice = ServeNotice | OutcomeNotice | BounceNotice | HitNotice


__all__ = [
    "ALIVE",
    "ALL_BUT_PICTURES",
    "COMMANDS",
    "COMMAND_BYTES",
    "EVERYTHING",
    "KINDS",
    "LONGEST_US",
    "MAX_EVENTS",
    "MAX_ROWS",
    "MESSAGE_BYTES",
    "PICTURES",
    "VERSION",
    "WALL_NS",
    "AimRacket",
    "Array",
    "AutoServe",
    "BounceNotice",
    "CameraInfo",
    "EventBatch",
    "Hello",
    "HitNotice",
    "Notice",
    "OutcomeNotice",
    "Pause",
    "PictureMessage",
    "Reply",
    "Reset",
    "RestRacket",
    "Resume",
    "Serve",
    "ServeNotice",
    "SetNoise",
    "SetScene",
    "SetSpeed",
    "SingleStep",
    "WorldState",
    "decode",
    "encode",
]

VERSION: Final = 1
ALIVE: Final = b"alive"
"""Topic of heartbeats: states without rows."""
EVERYTHING: Final = b""
"""Topic of all that is published but pictures, which older clients do not know."""
PICTURES: Final = b"picture"
"""Topic of pictures, which go only to those who name it."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorldState:
    """Where everything is up to `t_us`: comes last of all that belongs to its stretch, and again while paused.

    A source that does not know where the ball truly is, or has no racket, has no rows of it.
    """

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    wall_ns: int = whole(0, WALL_NS)
    """The sender's clock (Unix time) when it was sent."""
    start_us: int = whole(0, LONGEST_US)
    t_us: int = whole(0, LONGEST_US)
    phase: str = choice("idle", "serve", "return", "decided")
    """No ball; incoming; struck; decided but still rolling."""
    paused: bool = flag()
    speed_factor: float = bounded_number(0.0, 100.0)
    noise_hz: float = bounded_number(0.0, 20.0)
    auto_serve_mps: float = bounded_number(0.0, 9.0)
    """Speed of automatic serves, 0 when off."""
    real_time_factor: float = bounded_number(0.0, 1e6)
    """Recent simulated time per computing time; below speed factor times kept share the machine is too slow."""
    served: int = whole(0, WALL_NS)
    returned: int = whole(0, WALL_NS)
    scene: str = text(64, default="ball")
    """Scene of the simulation; empty where there is none."""
    readout_delayed: int = whole(0, WALL_NS, default=0)
    """Events of all cameras that the readout stamped late, since the session began."""
    readout_dropped: int = whole(0, WALL_NS, default=0)
    """Events that the readout lost."""
    readout_longest_us: int = whole(0, WALL_NS, default=0)
    """Longest delay of an event by the readout."""
    kept_share: float = bounded_number(0.0, 1.0, default=1.0)
    """Share of the speed factor at which the simulation runs, because the machine is too slow for more."""
    ball_t_us: NDArray[np.int64] = column("<i8", most=MAX_ROWS)
    ball: Array = column("<f8", 9, most=MAX_ROWS)
    """(N, 9) position, velocity and spin of the ball in the world; NaN without a ball."""
    ball_visible: NDArray[np.uint8] = column("|u1", most=MAX_ROWS)
    racket_t_us: NDArray[np.int64] = column("<i8", most=MAX_ROWS)
    racket: Array = column("<f8", 10, most=MAX_ROWS)
    """(M, 10) position, orientation wxyz, velocity."""

    def __post_init__(self) -> None:
        _same_length("state, ball", self.ball_t_us, self.ball, self.ball_visible)
        _same_length("state, racket", self.racket_t_us, self.racket)
        _ascending("state, ball_t_us", self.ball_t_us)
        _ascending("state, racket_t_us", self.racket_t_us)

    @property
    def ends_block(self) -> bool:
        """Whether it completes a block; a heartbeat does not."""
        return self.t_us > self.start_us

    def truth(self) -> BallTruth | None:
        """The ball's true rows; None if unknown."""
        if not len(self.ball_t_us):
            return None
        rows = self.ball
        return BallTruth(self.ball_t_us, rows[:, :3], rows[:, 3:6], rows[:, 6:9], self.ball_visible.astype(np.bool_))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EventBatch:
    """The events of one camera in [start_us, end_us), and, where that is known, where the ball is in its picture."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    wall_ns: int = whole(0, WALL_NS)
    camera: str = text(64)
    start_us: int = whole(0, LONGEST_US)
    end_us: int = whole(0, LONGEST_US)
    width_px: int = whole(1, 8192)
    height_px: int = whole(1, 8192)
    since_us: NDArray[np.uint32] = column("<u4", most=MAX_EVENTS)
    """Times since `start_us`."""
    x_px: NDArray[np.uint16] = column("<u2", most=MAX_EVENTS)
    y_px: NDArray[np.uint16] = column("<u2", most=MAX_EVENTS)
    on: NDArray[np.uint8] = column("|u1", most=MAX_EVENTS)
    truth_t_us: NDArray[np.int64] = column("<i8", most=MAX_ROWS)
    circle: Array = column("<f8", 3, most=MAX_ROWS)
    """(K, 3) u, v and radius of the ball; NaN where it is not visible."""

    def __post_init__(self) -> None:
        _same_length("events", self.since_us, self.x_px, self.y_px, self.on)
        _same_length("events, truth", self.truth_t_us, self.circle)
        _ascending("events, truth_t_us", self.truth_t_us)
        if self.end_us <= self.start_us or (len(self.since_us) and self.since_us[-1] >= self.end_us - self.start_us):
            raise LinkError("events outside their stretch", where="events")

    def events(self) -> Events:
        """The checked events.

        Raises:
            LinkError: if they are out of order or off the sensor.
        """
        try:
            sensor = SensorSize(self.width_px, self.height_px)
            t_us = self.since_us.astype(np.int64) + self.start_us
            return Events.from_columns(t_us, self.x_px, self.y_px, self.on, sensor)
        except EventsError as error:
            raise LinkError(str(error), where="events") from error

    def truth(self) -> PixelTruth | None:
        """The ball's true outline; None if unknown."""
        if not len(self.truth_t_us):
            return None
        u, v, r = self.circle.T
        return PixelTruth(self.truth_t_us, u, v, r, np.isfinite(u))


DISTORTION_LENGTHS: Final = tuple(sorted({count for counts in COEFFICIENTS.values() for count in counts}))


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInfo:
    """A camera, with its calibration if known: all three parts or none."""

    name: str = text(64)
    width_px: int = whole(1, 8192)
    height_px: int = whole(1, 8192)
    K: tuple[float, ...] | None = optional(vector(9, 1e6))
    distortion: tuple[float, ...] | None = optional(vector(DISTORTION_LENGTHS, 1e3))
    T_world_camera: tuple[float, ...] | None = optional(vector(16, 1e4))
    lens_model: LensModel | None = optional(choice(*COEFFICIENTS))
    """Lens model; None: pinhole, as in older versions."""

    @staticmethod
    def of(name: str, camera: Camera) -> CameraInfo:
        """Info of a calibrated camera."""
        K, distortion, pose = (
            tuple(np.ravel(a).tolist()) for a in (camera.K, camera.distortion, camera.T_world_camera)
        )
        size = camera.sensor
        return CameraInfo(
            name=name,
            width_px=size.width_px,
            height_px=size.height_px,
            K=K,
            distortion=distortion,
            T_world_camera=pose,
            lens_model=camera.model,
        )

    @staticmethod
    def uncalibrated(name: str, sensor: SensorSize) -> CameraInfo:
        """Info of an uncalibrated camera."""
        return CameraInfo(name=name, width_px=sensor.width_px, height_px=sensor.height_px)

    @property
    def sensor(self) -> SensorSize:
        """Size of the sensor."""
        return SensorSize(self.width_px, self.height_px)

    def camera(self) -> Camera | None:
        """The calibrated camera; None where its calibration is not known.

        Raises:
            LinkError: if it is impossible.
        """
        if self.K is None or self.distortion is None or self.T_world_camera is None:
            return None
        try:
            K, pose = np.reshape(self.K, (3, 3)), np.reshape(self.T_world_camera, (4, 4))
            return Camera(self.sensor, K, np.array(self.distortion), pose, self.lens_model or "pinhole")
        except RallyscopeError as error:
            raise LinkError(str(error), where=f"camera {self.name}") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """The answer to a command; to `hello` it names the cameras and the physics too."""

    id: int = whole(0, WALL_NS)
    ok: bool = flag()
    error: str = text(1000, default="")
    session: str = text(64)
    t_us: int = whole(0, LONGEST_US)
    """Simulated time at which the command took effect."""
    block_us: int = whole(1, 1_000_000)
    seed: int | None = optional(whole(0, WALL_NS))
    """Seed of the simulation; None where there is none."""
    cameras: tuple[CameraInfo, ...] = listing(CameraInfo, 16)
    """Event cameras."""
    frame_cameras: tuple[CameraInfo, ...] = listing(CameraInfo, 16)
    """Ordinary cameras, one of which may have the name of an event camera: it looks through its lens."""
    physics: PhysicsConfig | None = optional(settings(PhysicsConfig))
    """Physics of the simulation. Older servers do not send it and have the paper's."""
    robot: bool = flag(default=True)
    """Whether there is a robot for `aim_racket`. Older servers do not send it and have one."""
    preparing: float | None = optional(bounded_number(0.0, 1.0))
    """Progress of a server that is still compiling and rejects commands, 0 to 1."""

    def calibrated(self) -> dict[str, Camera]:
        """Calibrated cameras by name.

        Raises:
            LinkError: if one is impossible.
        """
        return _calibrated(self.cameras)

    def calibrated_frame_cameras(self) -> dict[str, Camera]:
        """Calibrated ordinary cameras that are no event cameras, by name.

        Raises:
            LinkError: if one is impossible.
        """
        events = {info.name for info in self.cameras}
        return _calibrated(info for info in self.frame_cameras if info.name not in events)


def _calibrated(infos: Iterable[CameraInfo]) -> dict[str, Camera]:
    """The calibrated ones among some cameras, by name."""
    found = {info.name: info.camera() for info in infos}
    return {name: camera for name, camera in found.items() if camera is not None}


KINDS: Final[dict[str, type]] = {
    "state": WorldState,
    "events": EventBatch,
    "picture": PictureMessage,
    "serve_notice": ServeNotice,
    "bounce": BounceNotice,
    "hit": HitNotice,
    "outcome": OutcomeNotice,
    "reply": Reply,
}
ALL_BUT_PICTURES: Final = sorted({name[:1].encode() for name in ("alive", *KINDS) if name not in ("picture", "reply")})
"""Beginnings of all published topics but that of pictures. First letters: who gives up everything for `alive` alone
keeps that, as it is another subscription."""
COMMANDS: Final[dict[str, type]] = {
    "hello": Hello,
    "serve": Serve,
    "aim_racket": AimRacket,
    "rest_racket": RestRacket,
    "pause": Pause,
    "resume": Resume,
    "step": SingleStep,
    "speed": SetSpeed,
    "noise": SetNoise,
    "scene": SetScene,
    "auto_serve": AutoServe,
    "reset": Reset,
}
_NAMES: Final = {kind: name for name, kind in (KINDS | COMMANDS).items()}


def encode(message: object, names: Mapping[type, str] = _NAMES) -> bytes:
    """The bytes of any message above, or of another whose kinds have `names`."""
    fields = {"v": VERSION, "kind": names[type(message)], **write_fields(message)}
    return bytes(msgpack.packb(fields, use_bin_type=True) or b"")


def decode(data: bytes, kinds: dict[str, type], most_bytes: int = MESSAGE_BYTES) -> Any:
    """The message in some bytes, which may be anything.

    Raises:
        LinkError: if it is too long, of another version, not of the `kinds`, or breaks a bound.
    """
    if len(data) > most_bytes:
        raise LinkError("message too long", expected=f"up to {most_bytes} bytes", got=len(data))
    try:
        fields = msgpack.unpackb(data, raw=False, strict_map_key=True, max_ext_len=0)
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException) as error:
        raise LinkError(f"not msgpack ({type(error).__name__})", got=f"{len(data)} bytes") from error
    if not isinstance(fields, dict):
        raise LinkError("not a message", expected="a map", got=type(fields).__name__)
    version = fields.get("v")
    if type(version) is not int or version != VERSION:
        got = repr(version)[:20]
        remedy = "use the same version of Rallyscope on both sides"
        raise LinkError("another version of the link", expected=f"version {VERSION}", got=got, remedy=remedy)
    name = fields.get("kind")
    kind = kinds.get(name) if isinstance(name, str) else None
    if kind is None:
        raise LinkError("no such message", expected=", ".join(kinds), got=repr(name)[:40])
    return read_fields(kind, fields, str(name))


def _same_length(where: str, *columns: np.ndarray) -> None:
    if len({len(item) for item in columns}) != 1:
        raise LinkError("columns differ in length", got=[len(item) for item in columns], where=where)


def _ascending(where: str, t_us: NDArray[np.int64]) -> None:
    if len(t_us) and (bool((np.diff(t_us) < 0).any()) or t_us[0] < 0 or t_us[-1] > LONGEST_US):
        raise LinkError("times run backwards or are out of range", where=where)
