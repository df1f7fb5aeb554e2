"""What a judge of strokes takes for granted, and when it has seen enough."""

from __future__ import annotations

from dataclasses import dataclass

from core.config import check_settings, setting
from core.table import REAL_DRAG, REAL_FRICTION, REAL_MAGNUS, REAL_RESTITUTION


@dataclass(frozen=True, slots=True, kw_only=True)
class OutcomeClassifierConfig:
    """Constants come with how sure they are. Two kinds of flights are tried, with air and without: the points decide.

    Nothing here is told by a simulation; the racket's pose is not needed either.
    """

    reach_x_m: float = setting(-0.8, -1.37, 0.0)
    """The racket meets balls on the robot's side of this plane only (choice); what turns elsewhere hit the net."""
    behind_m: float = setting(0.25, 0.02, 2.0)
    """A ball that is so far behind the hitting plane was missed (choice; longer than a stroke's follow-through)."""
    slowest_return_mps: float = setting(0.4, 0.05, 5.0)
    """A struck ball goes back to the net at least so fast along x (choice)."""
    guard_ms: float = setting(3.5, 0.0, 30.0)
    """Points so near a contact are left out: a window of 2 ms may hold both sides of it."""
    fewest_points: int = setting(6, 4, 100)
    """Fewest points of an outgoing flight before it is classified (choice)."""
    noise_m: float = setting(0.0003, 1e-5, 0.1, step=0.0001)
    """Added to what a point says of its own noise."""
    alike_points: float = setting(4.0, 1.0, 50.0)
    """So many neighbouring points err alike and count as one: errors of the chain change over some 6 ms."""
    bias_m: float = setting(0.0002, 0.0, 0.1, step=0.0001)
    """Common offset of all points of a flight along each axis (standard deviation)."""
    tilt_mps: float = setting(0.001, 0.0, 1.0, step=0.0005)
    """Velocity error because that offset changes along the flight (standard deviation)."""
    drag: float = setting(REAL_DRAG.value, 0.0, 1.0)
    """Drag coefficient of a flight with air."""
    drag_sigma: float = setting(0.03, 1e-6, 0.5)
    """What is not known of it."""
    magnus: float = setting(REAL_MAGNUS, 0.0, 0.5)
    """Magnus coefficient; only its product with the spin moves the ball."""
    spin_sigma_radps: float = setting(200.0, 1.0, 2000.0)
    """Prior standard deviation of a struck ball's spin about each axis (choice)."""
    restitution: float = setting((REAL_RESTITUTION.value + 0.9) / 2, 0.5, 1.0)
    """Restitution of the table, between recorded flights and other reports: only the next bounce needs it."""
    friction: float = setting(REAL_FRICTION.value, 0.0, 1.0)
    """Friction coefficient of the table."""
    after_m: float = setting(0.02, 0.001, 0.5)
    """How well a ball can be foretold after its first contact (standard deviation, choice) ..."""
    after_mps: float = setting(0.8, 0.0, 10.0)
    """... and how fast that grows: bounces scatter, and a net gives way as it likes."""
    follow_ms: float = setting(60.0, 5.0, 500.0)
    """So long after the first contact, points speak about which contact it was (choice)."""
    samples: int = setting(256, 32, 4096)
    """Flights that are drawn from what is known."""
    sure: float = setting(0.99, 0.5, 1.0)
    """A case that is so probable, and has been watched for `settle_ms` after the contact, is final (choice)."""
    settle_ms: float = setting(30.0, 0.0, 1000.0)
    """See `sure`."""
    patience_ms: float = setting(150.0, 10.0, 3000.0)
    """So long after the contact that is expected last, the judgement is final as it is (choice)."""
    lost_ms: float = setting(400.0, 50.0, 5000.0)
    """A ball that was not seen for so long is judged by what was seen (choice; a lob leaves the picture for less)."""

    def __post_init__(self) -> None:
        check_settings(self)
