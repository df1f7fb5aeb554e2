"""The constants of the paper's prediction; what the paper leaves open is a choice and says so."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

from core.config import check_settings, setting

PhysicsName = Literal["paper", "real"]


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperPredictorConfig:
    """Five observations, gravity, one reflection. The defaults are for the physics called `paper`."""

    observations: int = setting(5, 2, 50)
    """Points of a fit (paper: five)."""
    spacing_ms: float = setting(10.0, 0.5, 100.0)
    """Time between two of them (choice). Five consecutive ones at 1 kHz would span 4 ms: useless against noise."""
    hit_x_m: float = setting(-1.42, -3.0, 1.37)
    """The hitting plane (choice): 5 cm behind the robot's end of the table."""
    restitution: float = setting(0.90, 0.3, 1.0)
    """Vertical speed kept at the table (choice, the simulated table's)."""
    tangential_factor: float = setting(0.82, 0.0, 1.0)
    """Speed along the table kept (choice). A spinless ball keeps .73 at 3 m/s, .86 at 5 m/s and .92 at 9 m/s on the
    simulated table; real balls with spin .73 to 1.16, median .83. The prediction has room for one factor."""
    friction: float = setting(0.0, 0.0, 1.0)
    """If not 0, the factor follows from Coulomb friction on a ball without spin, by the angle at which it comes. That
    is not the paper's: the chain has it, because the racket moves early on what is expected before the bounce."""
    restitution_sigma: float = setting(0.03, 0.0, 0.3)
    """Standard deviation of the restitution; used for the uncertainties only."""
    tangential_sigma: float = setting(0.07, 0.0, 0.3)
    """Standard deviation of the tangential factor, spin included; used for the uncertainties only."""
    sigma_point_m: float = setting(0.005, 1e-5, 0.1, step=0.0005)
    """Standard deviation of an observed position along each axis; used for the uncertainties only."""
    bounce_rise_m: float = setting(0.012, 0.001, 0.2)
    """A bounce is a lowest point to which the ball fell by this much and from which it rose by as much: the vertical
    velocity changed its sign (choice: more than the noise, 5 ms of a rise at 2.4 m/s)."""
    bounce_height_m: float = setting(0.12, 0.02, 0.5)
    """Only a lowest point below this height is near the table (choice)."""
    hurry_ms: float = setting(30.0, 0.0, 200.0)
    """After the bounce, a ball that would be at the plane before so much time has passed since its fifth observation is
    predicted from three or four (choice: fast balls leave no time for five; 0 waits for them nevertheless)."""
    bounce_guard_ms: float = setting(3.0, 0.0, 30.0)
    """New observations begin so long after the lowest point, which may lie before the bounce (choice)."""

    bounce_wait_ms: float = setting(40.0, 0.0, 200.0)
    """From the expected bounce on, points are no longer taken for ones before it, for so long: a bounce is noticed only
    when the ball has risen again, and a fit across it is centimetres wrong (choice; 0 takes them)."""

    def __post_init__(self) -> None:
        check_settings(self)


def published_predictor() -> PaperPredictorConfig:
    """The predictor exactly as published: five new points after the bounce, without hurry, guard or wait."""
    return PaperPredictorConfig(hurry_ms=0.0, bounce_guard_ms=0.0, bounce_wait_ms=0.0)


def predictor_for(physics: PhysicsName, *, hit_x_m: float | None = None) -> PaperPredictorConfig:
    """The predictor with the table's behaviour in the physics called `paper` or `real`; the method stays the paper's.

    `real`: medians and spread over the bounces of 70 recorded flights between two players.
    """
    config = PaperPredictorConfig()
    if physics == "real":
        config = dataclasses.replace(
            config, restitution=0.94, tangential_factor=0.83, restitution_sigma=0.05, tangential_sigma=0.20
        )
    return config if hit_x_m is None else dataclasses.replace(config, hit_x_m=hit_x_m)
