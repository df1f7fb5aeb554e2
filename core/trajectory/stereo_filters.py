"""Filter settings for stereo points, by the errors of the detector that found them."""

from __future__ import annotations

import dataclasses

from core.trajectory.filter_config import FilterConfig, filter_for


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
