import numpy as np
import pytest

from core.events import rate_curve


@pytest.mark.parametrize(("length_ms", "bins"), [(1, 10), (7, 3), (1000, 400), (1001, 1)])
def test_rates_times_durations_are_the_events(length_ms: int, bins: int) -> None:
    counts = np.random.default_rng(length_ms).integers(0, 50, length_ms)
    curve = rate_curve(counts, bins=bins)
    assert len(curve.t_s) <= bins
    width_ms = -(-length_ms // bins)
    durations_s = np.full(len(curve.t_s), width_ms / 1e3)
    durations_s[-1] = (length_ms - width_ms * (len(curve.t_s) - 1)) / 1e3
    assert np.sum(curve.rate_hz * durations_s) == pytest.approx(counts.sum())
    assert np.all(np.diff(curve.t_s) > 0) and curve.t_s[0] > 0 and curve.t_s[-1] < length_ms / 1e3


def test_an_empty_recording_has_an_empty_curve() -> None:
    assert len(rate_curve(np.zeros(0, np.int64), bins=10).t_s) == 0
