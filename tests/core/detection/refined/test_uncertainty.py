"""How sure a fit says it is."""

import numpy as np
import pytest

from core.detection.refined.ball_fit import Quality
from core.detection.refined.detector import observed_covariance
from core.detection.refined.patch import MovingCircle

pytestmark = pytest.mark.numeric
CLEAN = Quality(0.15, 120.0, 1.0, 1.0, 0.0, 0.1, 0.9, 5.0, 1.0, 0.33)
FITTED = np.diag([0.01, 0.01, 0.002, 0.002, 0.01, 0.004])


def ball(r_px: float) -> MovingCircle:
    return MovingCircle(100.0, 50.0, 2.0, 0.0, r_px)


def test_a_worse_fit_and_a_larger_ball_are_less_sure() -> None:
    usual = observed_covariance(FITTED, ball(8.0), CLEAN)
    worse = observed_covariance(FITTED, ball(8.0), CLEAN._replace(residual_px=0.3))
    larger = observed_covariance(FITTED, ball(16.0), CLEAN)
    assert usual.shape == (5, 5) and (np.linalg.eigvalsh(usual) > 0).all()
    assert worse[2, 2] == 8 * usual[2, 2], "velocity by the residual alone, cubed"
    assert (np.diag(worse)[:2] > np.diag(usual)[:2]).all()
    assert (np.diag(larger)[:2] > np.diag(usual)[:2]).all() and larger[2, 2] == usual[2, 2]


def test_the_light_from_above_is_felt_down_the_picture() -> None:
    usual = observed_covariance(FITTED, ball(8.0), CLEAN)
    assert usual[1, 1] > usual[0, 0]
