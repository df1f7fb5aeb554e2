"""What the ball filter is fed: a position in space, or the pixel of one camera at a time of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.cameras.many_views_kernel import CameraArrays, project_with_slopes
from core.jit import njit
from core.trajectory.ball_kernel import AHEAD, STATE, glide
from core.trajectory.filter_kernel import observe

Array = NDArray[np.float64]

GATE: Final = 40.0
"""Gate on the squared normalised distance in three dimensions; a correct point exceeds it once in 10^8."""


class Innovation(NamedTuple):
    """How an observation stands to the estimate."""

    distance: float
    """Squared normalised distance (Mahalanobis)."""
    log_likelihood: float
    """But for a constant; an outlier counts as one at the gate."""


@dataclass(frozen=True, slots=True, eq=False)
class PointObservation:
    """A position of the ball in the world."""

    p_world_m: Array
    """(3,)."""
    noise_m2: Array
    """(3, 3) covariance."""
    gate: float = GATE

    def update(self, x: Array, cov: Array, scales: Array, tally: Array, lift: float) -> Innovation:
        """Update the estimate (14,) and its covariance (14, 14) in place, unless the position is beyond the gate.

        Args:
            x: (14,) estimate, changed in place.
            cov: (14, 14) its covariance, changed in place.
            scales: scales of the noise, learned along the way.
            tally: (2, 3) sums for them, changed in place.
            lift: not used.
        """
        return Innovation(*observe(x, cov, self.p_world_m, self.noise_m2, scales, self.gate, tally))


@dataclass(frozen=True, slots=True, eq=False)
class PixelObservation:
    """The ball in the picture of one camera: it says nothing of the distance."""

    uv_px: Array
    """(2,)."""
    noise_px2: Array
    """(2, 2) covariance."""
    camera: CameraArrays
    gate: float
    """On the squared normalised distance in two dimensions."""
    late_s: float = 0.0
    """The pixel is so much older than the estimate."""

    def update(self, x: Array, cov: Array, scales: Array, tally: Array, lift: float) -> Innovation:
        """Update the estimate (14,) and its covariance (14, 14) in place, unless the pixel is beyond the gate.

        The scales of the positions' noise stay as they are.

        Args:
            x: (14,) estimate, changed in place.
            cov: (14, 14) its covariance, changed in place.
            scales: not used.
            tally: not used.
            lift: acceleration per spin and velocity across it.
        """
        found = observe_pixel(x, cov, self.uv_px, self.noise_px2, self.camera, self.late_s, lift, self.gate)
        return Innovation(*found)


Observation = PointObservation | PixelObservation


@njit
def observe_pixel(
    x: Array, cov: Array, uv: Array, noise_px2: Array, camera: CameraArrays, late_s: float, lift: float, gate: float
) -> tuple[float, float]:
    """Extended Kalman update with a pixel (2,) of the time `late_s` ago: squared normalised distance, log likelihood.

    The pixel of a late camera is compared with the path flown back, which the estimate's position and velocity give.
    A ball that the camera cannot see changes nothing; its distance is infinite.

    Args:
        x: (14,) estimate, changed in place.
        cov: (14, 14) its covariance, changed in place.
        uv: (2,) pixel.
        noise_px2: (2, 2) its covariance.
        camera: where the camera is, and its lens.
        late_s: how long ago the pixel was, s.
        lift: acceleration per spin and velocity across it.
        gate: squared normalised distance beyond which the pixel is not taken.
    """
    then = x.copy()
    if late_s > 0.0:
        glide(x, -late_s, lift, then)
    speed = math.sqrt(then[3] * then[3] + then[4] * then[4] + then[5] * then[5]) + 1e-9
    slopes, p, along = np.empty((2, 3)), np.empty(3), np.empty(3)
    for k in range(3):
        along[k] = then[3 + k] / speed
        p[k] = then[k] + then[AHEAD] * along[k]
    u, v = project_with_slopes(p, camera.centre, camera.R, camera.lens, slopes)
    if math.isnan(u):
        return math.inf, -0.5 * gate
    miss_u, miss_v = uv[0] - u, uv[1] - v
    H, PH = np.zeros((2, STATE)), np.empty((STATE, 2))
    for row in range(2):
        for k in range(3):
            H[row, k] = slopes[row, k]
            # The ball was at p - late v when the late camera saw it.
            H[row, 3 + k] = -late_s * slopes[row, k]
            H[row, AHEAD] += slopes[row, k] * along[k]
    for i in range(STATE):
        for row in range(2):
            total = 0.0
            for k in range(STATE):
                total += cov[i, k] * H[row, k]
            PH[i, row] = total
    a, b, c = noise_px2[0, 0], noise_px2[0, 1], noise_px2[1, 1]
    for i in range(STATE):
        a += H[0, i] * PH[i, 0]
        b += H[0, i] * PH[i, 1]
        c += H[1, i] * PH[i, 1]
    determinant = a * c - b * b
    pulled_u, pulled_v = (c * miss_u - b * miss_v) / determinant, (a * miss_v - b * miss_u) / determinant
    distance = miss_u * pulled_u + miss_v * pulled_v
    likelihood = -0.5 * (min(distance, gate) + math.log(determinant))
    if not distance <= gate:
        return distance, likelihood
    for i in range(STATE):
        gain_u = (c * PH[i, 0] - b * PH[i, 1]) / determinant
        gain_v = (a * PH[i, 1] - b * PH[i, 0]) / determinant
        x[i] += PH[i, 0] * pulled_u + PH[i, 1] * pulled_v
        # Half of it, mirrored: rounding cannot make the covariance asymmetric.
        for j in range(i + 1):
            cov[i, j] -= gain_u * PH[j, 0] + gain_v * PH[j, 1]
            cov[j, i] = cov[i, j]
    return distance, likelihood
