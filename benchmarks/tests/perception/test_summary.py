import math
from dataclasses import replace

import pytest

from benchmarks.perception import comparisons
from benchmarks.perception.comparisons import SeedRun, estimate, interval
from benchmarks.perception.results import PerceptionResult, median_with_lost

ONE = PerceptionResult(
    scene="ball", seed=7, recording="real1", method="paper", window_us=2000, windows=100, asked=80, found=60,
    answers=50, false=5, error_px=(1.0, 3.0), events=9000, cpu_ms=(0.1, 0.3), recovery_ms=(2.0, None, 4.0),
    bound_px=(0.02,), pixel_bound_px=(0.03,), point_mm=(2.0, 4.0), points_without_ball=0, hits=4,
    hit_mm=(5.0,), shown=None,
)  # fmt: skip
NOTHING = replace(ONE, asked=0, found=0, answers=0, false=0, error_px=(), events=0, cpu_ms=(), recovery_ms=(),
                  point_mm=(), hits=0, hit_mm=())  # fmt: skip


def test_counts_add_up_before_they_are_divided() -> None:
    both = [ONE, replace(ONE, asked=20, found=20, answers=150, false=0, events=1000)]
    assert comparisons.precision(both) == pytest.approx(1 - 5 / 200)
    assert comparisons.recall(both) == pytest.approx(80 / 100)
    assert comparisons.bytes_per_detection(both) == pytest.approx(4 * 10_000 / 195)
    assert comparisons.error_mean_px([ONE]) == 2.0 and comparisons.hits_told([ONE]) == 0.25


def test_light_waits_for_half_a_window_and_at_worst_for_a_whole_one() -> None:
    assert comparisons.latency_p50_ms([ONE]) == pytest.approx(0.23 + 1.0 + 0.2)
    assert comparisons.latency_p99_ms([ONE]) == pytest.approx(0.23 + 2.0 + 0.298)


def test_what_was_never_found_takes_endlessly() -> None:
    assert median_with_lost([2.0, None, 4.0]) == 4.0
    assert median_with_lost([1.0, 2.0]) == 1.5
    assert math.isinf(median_with_lost([1.0, None, None])) and math.isnan(median_with_lost([]))
    assert comparisons.never_found([ONE]) == pytest.approx(1 / 3)


@pytest.mark.parametrize("name", comparisons.FIGURES)
def test_nobody_knows_a_figure_of_nothing(name: str) -> None:
    assert math.isnan(comparisons.FIGURES[name]([]))
    assert math.isnan(comparisons.FIGURES[name]([NOTHING]))


def test_few_seeds_show_the_range_of_recordings_and_more_a_bootstrap_interval() -> None:
    assert interval([0.5], [0.2, math.nan, 0.9]) == (0.2, 0.9)
    low, high = interval([1.0, 2.0, 3.0, 4.0], [0.0, 9.0])
    assert 1.0 < low < 2.0 and 3.0 < high < 4.0
    assert interval([2.0, 2.0, 2.0], []) == (2.0, 2.0)
    assert interval([1.0, math.inf, 2.0], []) == (1.0, math.inf)
    assert all(map(math.isnan, interval([math.nan], [math.nan])))


def test_a_seed_is_pooled_over_its_recordings_and_seeds_are_averaged() -> None:
    worse = replace(ONE, recording="real2", found=20)
    runs = [SeedRun(7, (ONE, worse), ()), SeedRun(8, (replace(ONE, seed=8, found=80),), ())]
    found = estimate(runs, "paper", comparisons.recall)
    assert found == pytest.approx((0.75, 0.25, 1.0))
    assert math.isnan(estimate(runs, "refined", comparisons.recall).value)
