"""Where the ball is in a picture at any time, also with columns that hold anything where it is not visible."""

import numpy as np
import pytest

from core.recordings import PixelTruth


@pytest.mark.filterwarnings("error")
def test_what_is_not_visible_may_be_any_number_and_does_no_harm() -> None:
    t_us = np.array([0, 10, 20, 30])
    u_px = np.array([1.0, np.inf, -np.inf, 4.0])
    truth = PixelTruth(t_us, u_px, u_px, u_px, np.array([True, False, False, True]))
    seen = truth.at([0, 5, 10, 15, 20, 30])
    assert seen.visible.tolist() == [True, False, False, False, False, True]
    np.testing.assert_array_equal(seen.u_px, [1.0, np.nan, np.nan, np.nan, np.nan, 4.0])
