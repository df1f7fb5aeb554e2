"""Commands of a simulation server; each is answered with a Reply with its `id`."""

from __future__ import annotations

from dataclasses import dataclass

from core.errors import LinkError
from core.live.link.bounds import LONGEST_US, WALL_NS
from core.live.link.fields import bounded_number, choice, optional, vector, whole
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
