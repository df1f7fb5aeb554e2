"""How sure a fit is, as its errors on drawn scenes and sensors say."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.refined.ball_fit import Quality
from core.detection.refined.patch import MovingCircle

USUAL_RESIDUAL_PX: Final = 0.15
USUAL: Final = 0.5
"""Of the fit's own variance there: points are better than the spread that weights them, but err alike."""
SHADE: Final = (0.004, 0.01)
"""Across and down the picture, shares of the radius: light from above leaves the lower rim pale."""


def observed_covariance(fitted: NDArray[np.float64], ball: MovingCircle, quality: Quality) -> NDArray[np.float64]:
    """(5, 5) of place [px], velocity [px/ms] and radius [px] from what the fit says if every point erred by itself.

    The errors grow with the residual, faster than it. Measured on 43 recordings of drawn scenes, half with drawn
    sensors, each sensor's delay known: the squared error of the centre over this has a mean of 1.1, from 0.5 for the
    cleanest quarter of the fits to 1.9 for the worst, and of 0.6 along the motion and 1.5 across it.
    """
    covariance = USUAL * (quality.residual_px / USUAL_RESIDUAL_PX) ** 3 * fitted[:5, :5]
    for axis, share in enumerate(SHADE):
        covariance[axis, axis] += (share * ball.r) ** 2
    return covariance
