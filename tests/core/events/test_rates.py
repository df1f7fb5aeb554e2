import numpy as np
import pytest

from core.events import rate_curve


@pytest.mark.parametrize(("length_ms", "bins"), [(1, 10), (7, 3), (1000, 400), (1001, 1)])
def test_rates_times_durations_are_the_events(length_ms: int, bins: int) -> None:
    counts = np.random.default_rng(length_ms).integers(0, 50, length_ms)
    curve = rate_curve(counts, 1000 * length_ms, bins=bins)
    assert len(curve.t_s) <= bins
    width_ms = -(-length_ms // bins)
    durations_s = np.full(len(curve.t_s), width_ms / 1e3)
    durations_s[-1] += (length_ms - width_ms * len(curve.t_s)) / 1e3
    assert np.sum(curve.rate_hz * durations_s) == pytest.approx(counts.sum())
    assert np.all(np.diff(curve.t_s) > 0) and curve.t_s[0] > 0 and curve.t_s[-1] < length_ms / 1e3


def test_an_empty_recording_has_an_empty_curve() -> None:
    assert len(rate_curve(np.zeros(0, np.int64), 0, bins=10).t_s) == 0


@pytest.mark.parametrize("length_us", [400_001, 400_300, 400_900, 401_000, 402_300, 799_999])
def test_a_steady_rate_does_not_fall_where_the_last_millisecond_has_only_begun(length_us: int) -> None:
    t_us = np.arange(0, length_us, 10)
    counts = np.bincount(t_us // 1000)
    curve = rate_curve(counts, length_us, bins=400)
    np.testing.assert_allclose(curve.rate_hz, 1e5, rtol=0.03)
    assert curve.t_s[-1] < length_us / 1e6


def test_the_index_may_be_shorter_than_the_recording() -> None:
    np.testing.assert_allclose(rate_curve(np.full(10, 7), 50_000, bins=5).rate_hz, 7e3)
