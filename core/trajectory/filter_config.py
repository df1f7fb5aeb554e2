"""Assumptions of the filter about air, table and observations, with their uncertainties, for each detector's points."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final, NamedTuple

from core.config import check_settings, setting
from core.table import REAL_DRAG, REAL_FRICTION, REAL_MAGNUS, REAL_RESTITUTION, FittedConstant
from core.trajectory.config import PhysicsName

PAPER: Final = {
    "drag": 0.0,
    "drag_sigma": 1e-6,
    "magnus": 0.0,
    "spin_sigma_radps": 5.0,
    "restitution": 0.90,
    "restitution_sigma": 0.01,
    "friction": 0.15,
    "friction_sigma": 0.01,
}
"""Settings for the physics called `paper`: no air, no spin, and the simulated table."""


UNKNOWN: Final = {
    "drag": 0.50,
    "drag_sigma": 0.06,
    "magnus": REAL_MAGNUS,
    "spin_sigma_radps": 200.0,
    "restitution": 0.92,
    "restitution_sigma": 0.03,
    "friction": 0.22,
    "friction_sigma": 0.05,
}
"""Unknown air and table: published values with their spread (drag .40 to .55, tables
.88 to .96 and .15 to .30)."""


LEAST_SIGMA: Final = 1e-6
"""The smallest uncertainty that a setting of the filter takes."""
AIR_OF_FITTED: Final = 0.99
"""Probability of air where its drag was fitted: all but certain, the most that `air_probability` takes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterConfig:
    """The defaults are for the physics called `real`."""

    sigma_point_m: float = setting(0.003, 1e-5, 0.1, step=0.0005)
    """Standard deviation of an observed position along each axis, where the observation does not bring its own."""
    noise_m: float = setting(0.0, 0.0, 0.1, step=0.0005)
    """Noise added to the covariance of an observation."""
    bias_m: float = setting(0.0, 0.0, 0.1, step=0.0001)
    """Common offset of a flight's observations along each axis (standard deviation): more do not make it
    less, so it is added to what is predicted."""
    spin_bias_radps: float = setting(0.0, 0.0, 100.0, step=0.5)
    """Error of the spin about y, across the table (standard deviation): the observations' errors change
    along a flight as a spin would have it. Added to what is predicted."""
    adapt_points: int = setting(8, 0, 10_000)
    """The scale of the noise is learnt from the innovations, as if so many points had spoken for what was said of it;
    0 takes it for granted."""
    ahead_m: float = setting(0.0, 0.0, 0.1, step=0.0005)
    """Common offset of the observations along the flight (standard deviation), constant for a while."""
    ahead_s: float = setting(0.15, 0.001, 10.0)
    """Correlation time of that error."""
    drag: float = setting(REAL_DRAG.value, 0.0, 1.0)
    """Drag coefficient, fitted to recorded flights."""
    drag_sigma: float = setting(0.02, 1e-6, 0.5)
    """What is not known of it."""
    magnus: float = setting(REAL_MAGNUS, 0.0, 0.5)
    """Magnus coefficient; only its product with the spin moves the ball in the air."""
    spin_sigma_radps: float = setting(200.0, 1.0, 1000.0)
    """Standard deviation of the spin about each axis before anything is seen."""
    restitution: float = setting(REAL_RESTITUTION.value, 0.5, 1.0)
    """Restitution of the table, fitted to recorded flights."""
    restitution_sigma: float = setting(0.02, 1e-6, 0.3)
    """What is not known of it."""
    friction: float = setting(REAL_FRICTION.value, 0.0, 1.0)
    """Friction coefficient of the table, fitted to recorded flights."""
    friction_sigma: float = setting(0.02, 1e-6, 0.3)
    """What is not known of it."""
    table_sigma_m: float = setting(0.002, 0.0, 0.05, step=0.0005)
    """Standard deviation of the table's height in the world of the observations (choice: a calibration's error)."""
    air_noise: float = setting(0.005, 0.0, 5.0)
    """White acceleration, m/s^2 per root hertz: what the model of the air leaves out."""
    bounce_noise_mps: float = setting(0.01, 0.0, 1.0)
    """Scatter of each velocity component from bounce to bounce."""
    restless_air: float = setting(0.5, 0.0, 5.0)
    """`air_noise` of a flight that the model describes less well: with it the standard deviations of 49 recorded
    flights 100 ms ahead are right."""
    restless_bounce_mps: float = setting(0.1, 0.0, 1.0)
    """`bounce_noise_mps` of such a flight."""
    restless_odds: float = setting(20.0, 0.0, 1e6)
    """How many flights are like that for each that is not (choice); which one this is, its points decide. 0: none."""
    perhaps_real: bool = False
    """Nothing exact is said of air and table: they are as published, within their spread, there may be no air at all,
    and what the balls say of that is carried from one to the next (`learned_constants`)."""
    has_fitted_constants: bool = False
    """Where constants are learned: `drag`, `restitution` and `friction` with their sigmas were fitted to other balls of
    the same air and table, and are what is known before the first ball, instead of the published values."""
    air_probability: float = setting(0.8, 0.01, 0.99)
    """Prior probability that there is air (choice: only simulated balls fly without it)."""
    drag_scatter: float = setting(0.045, 0.0, 0.5)
    """Standard deviation of the drag coefficient from ball to ball, where it is learned: it depends on speed and
    spin."""
    restitution_scatter: float = setting(0.025, 0.0, 0.3)
    """Standard deviation of the table's restitution from ball to ball."""
    friction_scatter: float = setting(0.035, 0.0, 0.3)
    """Standard deviation of the table's friction from ball to ball."""
    alike_points: float = setting(3.0, 1.0, 100.0)
    """So many points err alike: what they say of the kinds of flights counts for so much less. By 31 recorded flights
    (the likeliest of 1, 2, 3 and 10)."""
    bounce_guard_ms: float = setting(0.0, 0.0, 30.0)
    """Points this long after a bounce are ignored: a window of events may contain both sides of it."""
    least_seen_ms: float = setting(20.0, 1.0, 200.0)
    """Observed time before the first prediction of a flight."""
    every_ms: float = setting(4.0, 0.0, 50.0)
    """Shortest time between predictions; the estimate uses every point."""

    def __post_init__(self) -> None:
        check_settings(self)


class FlightProcessNoise(NamedTuple):
    """Process noise of one kind of flights with unknown constants."""

    share: float
    """Prior probability of such flights."""
    air: float | None
    """White acceleration, m/s^2 per root hertz; None: as the configuration says."""
    bounce_mps: float | None
    """Scatter of each velocity component from bounce to bounce."""


PROCESS_NOISE_KINDS: Final = (
    FlightProcessNoise(0.2, None, None),
    FlightProcessNoise(0.3, 0.1, 0.05),
    FlightProcessNoise(0.5, 0.6, 0.1),
)
"""From simulated balls, of which the model leaves nothing out, to real ones. By every second of the recorded flights
with up to 450 rad/s, at 140 points/s and 3 mm of noise: the likeliest of some, and of equally likely ones those that
are less sure."""


def filter_for(physics: PhysicsName, *, sigma_point_m: float = 0.003) -> FilterConfig:
    """The filter for the physics called `paper` (no air, no serve with spin) or `real`."""
    return with_physics(FilterConfig(sigma_point_m=sigma_point_m), physics)


def with_unknown_constants(config: FilterConfig) -> FilterConfig:
    """The config for unknown constants of air and table: only their published spread is known."""
    return dataclasses.replace(config, **UNKNOWN)


def without_air(config: FilterConfig) -> FilterConfig:
    """The config without air, where spin does not move the ball, for serves without spin."""
    nothing = {name: PAPER[name] for name in ("drag", "drag_sigma", "magnus", "spin_sigma_radps")}
    return dataclasses.replace(config, **nothing)


def with_fitted_constants(
    config: FilterConfig, drag: FittedConstant, restitution: FittedConstant, friction: FittedConstant, magnus: float
) -> FilterConfig:
    """The config that begins with constants fitted to other balls, and goes on learning them from each ball.

    One ball differs from the mean of a fit by more than the fit's spread (`drag_scatter` and its like come on top).

    Args:
        config: everything else.
        drag: drag coefficient.
        restitution: of the table.
        friction: of the table.
        magnus: Magnus coefficient, taken as exact.
    """
    return dataclasses.replace(
        config,
        drag=drag.value,
        drag_sigma=max(drag.sigma, LEAST_SIGMA),
        restitution=restitution.value,
        restitution_sigma=max(restitution.sigma, LEAST_SIGMA),
        friction=friction.value,
        friction_sigma=max(friction.sigma, LEAST_SIGMA),
        magnus=magnus,
        spin_sigma_radps=UNKNOWN["spin_sigma_radps"],
        perhaps_real=True,
        has_fitted_constants=True,
        air_probability=AIR_OF_FITTED,
    )


def with_physics(config: FilterConfig, physics: PhysicsName) -> FilterConfig:
    """The config for the known constants of the physics profile `paper` or `real`."""
    if physics == "real":
        real = FilterConfig()
        return dataclasses.replace(config, **{name: getattr(real, name) for name in PAPER})
    return dataclasses.replace(config, **PAPER)


def chain_filter() -> FilterConfig:
    """The filter for stereo points of windows of 2 ms, by their errors on simulated serves of 3 to 9 m/s. It finds out
    whether a ball flies as in the physics `paper` or `real`.

    Along the flight they are systematic, 10 mm ahead to 5 mm behind, and change slowly; across it they hardly change
    from one window to the next, which an estimate of the noise from point to point would take for certainty. A window
    that holds both sides of a bounce gives a circle that is up to 13 mm off.
    """
    return dataclasses.replace(
        filter_for("paper"),
        noise_m=0.002,
        adapt_points=0,
        ahead_m=0.008,
        ahead_s=0.3,
        air_noise=0.03,
        restless_odds=0.0,
        perhaps_real=True,
        bounce_guard_ms=3.0,
        table_sigma_m=0.001,
    )


def refined_filter() -> FilterConfig:
    """The filter for the points of the method `refined`, by their errors on simulated serves of 3 to 9 m/s.

    From one to the next these hardly err; but a ball lit from above is seen up to a millimetre too high all the way.
    How far they lie ahead follows from a sensor's delay, which is taken as known to 50 us. How that changes along the
    flight looks like back or top spin: 2.6 and 3.3 rad/s in the mean of 20 spinning serves of 5 and of 7 m/s.
    """
    return dataclasses.replace(
        chain_filter(), noise_m=0.0001, bias_m=0.00085, spin_bias_radps=3.0, ahead_m=0.0003, air_noise=0.002
    )
