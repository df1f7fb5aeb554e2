"""Settings of the outcome classifier."""

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
    """The racket hits balls only on the robot's side of this plane (choice); balls that turn elsewhere hit the net."""
    behind_m: float = setting(0.25, 0.02, 2.0)
    """A ball this far behind where it was to be hit was missed (choice; longer than a stroke's follow-through)."""
    slowest_return_mps: float = setting(0.4, 0.05, 5.0)
    """Slowest speed along x of a struck ball (choice)."""
    guard_ms: float = setting(3.5, 0.0, 30.0)
    """Points this close to a contact are ignored: a window of 2 ms may contain both sides of it."""
    fewest_points: int = setting(6, 4, 100)
    """Fewest points of an outgoing flight before it is classified (choice)."""
    noise_m: float = setting(0.0003, 1e-5, 0.1, step=0.0001)
    """Noise added to a point's own covariance."""
    alike_points: float = setting(4.0, 1.0, 50.0)
    """Neighbouring points with correlated errors, which count as one: errors of the chain change within about 6 ms."""
    bias_m: float = setting(0.0002, 0.0, 0.1, step=0.0001)
    """Common offset of all points of a flight along each axis (standard deviation)."""
    tilt_mps: float = setting(0.001, 0.0, 1.0, step=0.0005)
    """Velocity error because that offset changes along the flight (standard deviation)."""
    drag: float = setting(REAL_DRAG.value, 0.0, 1.0)
    """Drag coefficient of a flight with air."""
    drag_sigma: float = setting(0.03, 1e-6, 0.5)
    """Standard deviation of `drag`."""
    magnus: float = setting(REAL_MAGNUS, 0.0, 0.5)
    """Magnus coefficient; only its product with the spin moves the ball."""
    spin_sigma_radps: float = setting(200.0, 1.0, 2000.0)
    """Prior standard deviation of a struck ball's spin about each axis (choice)."""
    restitution: float = setting((REAL_RESTITUTION.value + 0.9) / 2, 0.5, 1.0)
    """Restitution of the table, between recorded flights and other reports: only the next bounce needs it."""
    friction: float = setting(REAL_FRICTION.value, 0.0, 1.0)
    """Friction coefficient of the table."""
    after_m: float = setting(0.02, 0.001, 0.5)
    """Prediction error of a ball's position after its first contact (standard deviation, choice) ..."""
    after_mps: float = setting(0.8, 0.0, 10.0)
    """... and its growth per second: bounces scatter, and the net is soft."""
    follow_ms: float = setting(60.0, 5.0, 500.0)
    """Points up to this long after the first contact are used to identify the contact (choice)."""
    samples: int = setting(256, 32, 4096)
    """Number of sampled flights."""
    sure: float = setting(0.99, 0.5, 1.0)
    """Probability from which a case is final, `settle_ms` after the contact (choice)."""
    settle_ms: float = setting(30.0, 0.0, 1000.0)
    """See `sure`."""
    patience_ms: float = setting(150.0, 10.0, 3000.0)
    """This long after the latest possible contact the classification is final in any case (choice)."""
    lost_ms: float = setting(400.0, 50.0, 5000.0)
    """A ball unseen for this long is classified by what was seen (choice; a lob leaves the picture for less)."""

    def __post_init__(self) -> None:
        check_settings(self)
