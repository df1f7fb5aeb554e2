"""What happens to the ball, told as it happens: served, bounced, hit, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass

from core.live.link.bounds import LONGEST_US, WALL_NS
from core.live.link.fields import bounded_number, numbered, text, vector, whole
from core.physics.episode import Case


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeNotice:
    """A ball was put into play."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    t_us: int = whole(0, LONGEST_US)
    speed_mps: float = bounded_number(0.0, 100.0)
    p_m: tuple[float, ...] = vector(3, 100.0)
    v_mps: tuple[float, ...] = vector(3, 100.0)
    spin_radps: tuple[float, ...] = vector(3, 2000.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class OutcomeNotice:
    """What came of a served ball."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    t_us: int = whole(0, LONGEST_US)
    serve_us: int = whole(0, LONGEST_US)
    speed_mps: float = bounded_number(0.0, 100.0)
    case: Case = numbered(Case)  # noqa: RUF009 - it declares a field
    arrival: tuple[float, ...] = vector(6, 1000.0, nan=True)
    """Position and velocity of the ball at the hitting plane or the racket, whichever it met first."""
    q_wxyz: tuple[float, ...] = vector(4, 1.001, nan=True)
    """Of the racket when it hit."""
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
    """Of the ball's centre."""
    v_mps: tuple[float, ...] = vector(3, 1000.0)
    """Just after it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HitNotice:
    """The racket hit the ball."""

    session: str = text(64)
    seq: int = whole(0, WALL_NS)
    t_us: int = whole(0, LONGEST_US)
    p_m: tuple[float, ...] = vector(3, 100.0)
    """Of the ball's centre."""
    v_mps: tuple[float, ...] = vector(3, 1000.0)
    """Just after it."""
    v_before_mps: tuple[float, ...] = vector(3, 1000.0)
    q_wxyz: tuple[float, ...] = vector(4, 1.001)
    """Of the racket."""


Notice = ServeNotice | OutcomeNotice | BounceNotice | HitNotice
