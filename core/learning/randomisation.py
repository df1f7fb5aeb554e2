"""Domain randomisation: what differs from ball to ball, and how far.

Each switch draws something of the world anew for every ball, uniformly within a range. The learner is told nothing of
it: it sees the same kind of state as before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

from core.config import check_settings, field_spec, setting
from core.physics.constants_file import FittedConstants

Randomised = Literal["physics", "latency", "rubber", "calibration"]
RANDOMISED: Final[tuple[Randomised, ...]] = ("physics", "latency", "rubber", "calibration")


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomisationConfig:
    """What is drawn for each ball, and the ranges. A range is the half of it on each side, unless it says otherwise."""

    physics: bool = False
    """Air and table: drag, the table's restitution and its friction, within what is published, or within
    what `fit-physics` left open of fitted constants."""
    latency: bool = False
    """The racket is late."""
    rubber: bool = False
    """Restitution and grip of the racket's rubber."""
    calibration: bool = False
    """The cameras' frame is turned and shifted against the world: states and the place of the racket are off."""
    drag: float = setting(0.24, 0.0, 0.9)
    """Share of the drag coefficient; physics without air stay so. Two standard deviations of what is published,
    0.5 +- 0.06 (`core.trajectory.filter_config.UNKNOWN`)."""
    table_restitution: float = setting(0.06, 0.0, 0.3)
    """Two standard deviations of what is published, 0.92 +- 0.03. A fit of one table has 0.009 (`core.table`)."""
    table_friction: float = setting(0.10, 0.0, 0.3)
    """Two standard deviations of what is published, 0.22 +- 0.05. A fit of one table has 0.010."""
    rubber_restitution: float = setting(0.075, 0.0, 0.3)
    """Half of what inverted rubbers differ by, 0.75 to 0.90 (`core.physics.config`)."""
    rubber_grip: float = setting(0.10, 0.0, 0.5)
    """Range of the tangential restitution, which is not drawn below 0 (choice: an eighth of `real`)."""
    latest_ms: float = setting(20.0, 0.0, 100.0)
    """The racket is 0 to this late. Half of a latency of 40 ms that nothing leads, which costs the built-in controller
    a fifth of its balls (docs/measured/robustness-report.md)."""
    turned_deg: float = setting(0.5, 0.0, 5.0)
    """The frame is turned by 0 to this about a random axis through the middle of the table. The largest error of a
    calibration in docs/measured/robustness-report.md."""
    shifted_m: float = setting(0.005, 0.0, 0.05)
    """Shift along each axis (choice: the noise of `truth+noise`)."""
    racket_deg: float = setting(1.0, 0.0, 5.0)
    """Range of each angle of the racket `uncertain`: 1 degree as in docs/measured/robustness-report.md."""
    racket_mps: float = setting(0.1, 0.0, 1.0)
    """Range of the speed of the racket `uncertain` (choice: a tenth of its speed at serves of 5 m/s)."""

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def names(self) -> tuple[Randomised, ...]:
        """What is switched on."""
        return tuple(name for name in RANDOMISED if getattr(self, name))


def fitted_ranges(config: RandomisationConfig, constants: FittedConstants) -> RandomisationConfig:
    """The config with two standard deviations of a fit as the ranges of air and table."""
    drag, restitution, friction = constants.drag_coefficient, constants.restitution, constants.friction
    wanted = {
        "drag": 2 * drag.sigma / max(drag.value, 1e-9),
        "table_restitution": 2 * restitution.sigma,
        "table_friction": 2 * friction.sigma,
    }
    return replace(config, **{name: min(value, _largest(name)) for name, value in wanted.items()})


def _largest(name: str) -> float:
    bounds = field_spec(RandomisationConfig, name).bounds
    assert bounds is not None
    return bounds.high
