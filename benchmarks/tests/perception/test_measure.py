import numpy as np

from benchmarks.perception.measure import appearances, recovery_times_ms
from core.metrics.run import WindowAnswers
from core.recordings import PixelTruth


def truth(visible_ms: list[tuple[int, int]], until_ms: int = 100) -> PixelTruth:
    """A ball at (50, 50) in view in these stretches, a sample every 0.5 ms."""
    t_us = np.arange(0, 1000 * until_ms, 500)
    visible = np.any([(1000 * a <= t_us) & (t_us <= 1000 * b) for a, b in visible_ms], axis=0)
    place = np.where(visible, 50.0, np.nan)
    return PixelTruth(t_us, place, place, np.where(visible, 8.0, np.nan), visible)


def answers(rows: list[tuple[int, float]]) -> WindowAnswers:
    """Windows that end and hold at these milliseconds, with their u."""
    t_us = np.array([1000 * ms for ms, _ in rows], np.int64)
    u = np.array([u for _, u in rows], np.float64)
    v = np.where(np.isnan(u), np.nan, 50.0)
    return WindowAnswers(t_us, t_us, u, v, v, np.zeros(len(rows), np.int32))


def test_a_ball_appears_after_it_was_away_and_if_it_stays() -> None:
    assert appearances(truth([(10, 30), (33, 50), (60, 64), (75, 90)])) == [(10_000, 30_000), (75_000, 90_000)]
    assert appearances(truth([(0, 30)])) == [], "nobody knows since when it was there"
    assert appearances(truth([(99, 10)])) == []


def test_recovery_is_the_time_to_the_end_of_the_first_right_answer() -> None:
    said = answers([(12, np.nan), (14, 70.0), (16, 51.0), (18, 50.0), (70, 50.0)])
    assert recovery_times_ms(said, truth([(10, 30), (60, 80)])) == [6.0, 10.0]


def test_a_ball_that_is_never_found_has_no_time() -> None:
    assert recovery_times_ms(answers([(12, 90.0), (50, 50.0)]), truth([(10, 30)])) == [None]
    assert recovery_times_ms(answers([]), truth([(10, 30)])) == [None]
