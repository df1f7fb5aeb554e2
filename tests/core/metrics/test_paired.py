"""Paired comparisons: known answers, scipy as the reference, and intervals that hold the truth as often as they say."""

import math

import numpy as np
import pytest
from scipy import stats

from core.errors import ConfigError
from core.metrics.paired import holm, pair_by_seed, paired_difference, paired_ratio, seeds_as_text

RNG = np.random.default_rng


def test_seed_sets_that_differ_are_not_compared_and_one_line_says_which() -> None:
    ours, theirs = dict.fromkeys(range(20), 1.0), {0: 1.0, 1: 1.0, 2: 1.0, 4: 1.0}
    with pytest.raises(ConfigError) as refused:
        pair_by_seed(ours, theirs, where="ours against PPO")
    message = str(refused.value)
    assert message.startswith("ours against PPO: not compared, the seeds differ")
    assert "0-19" in message and "0-2, 4" in message and "\n" not in message


def test_pairs_are_of_one_seed_whatever_the_order() -> None:
    seeds, ours, theirs = pair_by_seed({3: 30.0, 1: 10.0}, {1: 11.0, 3: 33.0}, where="")
    assert seeds == (1, 3)
    assert ours.tolist() == [10, 30] and theirs.tolist() == [11, 33]


def test_a_difference_is_scipy_s_paired_t_test() -> None:
    rng = RNG(1)
    ours, theirs = rng.normal(70, 20, 20), rng.normal(90, 20, 20)
    found = paired_difference(ours, theirs)
    expected = stats.ttest_rel(ours, theirs)
    interval = expected.confidence_interval(0.95)
    assert (found.count, found.estimate) == (20, pytest.approx(np.mean(ours - theirs)))
    assert (found.low, found.high, found.p) == pytest.approx((interval.low, interval.high, expected.pvalue))


def test_a_ratio_is_the_t_test_of_the_logs_and_near_the_bootstrap() -> None:
    rng = RNG(2)
    shared = np.exp(rng.normal(4.5, 0.4, 20))
    ours, theirs = 0.6 * shared * np.exp(rng.normal(0, 0.1, 20)), shared
    found = paired_ratio(ours, theirs, null=0.645)
    expected = stats.ttest_rel(np.log(ours), np.log(0.645 * theirs))
    assert found.p == pytest.approx(expected.pvalue)
    assert found.estimate == pytest.approx(stats.gmean(ours / theirs))
    assert found.low < 0.6 < found.high

    def ratio(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.exp(np.mean(np.log(a) - np.log(b), axis=axis))

    resampled = stats.bootstrap((ours, theirs), ratio, paired=True, method="BCa", rng=RNG(3)).confidence_interval
    assert (found.low, found.high) == pytest.approx((resampled.low, resampled.high), rel=0.02)


def test_the_ratio_turned_round_is_its_inverse() -> None:
    rng = RNG(4)
    ours, theirs = rng.uniform(50, 150, 12), rng.uniform(80, 300, 12)
    found, turned = paired_ratio(ours, theirs, null=0.8), paired_ratio(theirs, ours, null=1 / 0.8)
    assert (found.estimate, found.low, found.high) == pytest.approx(
        (1 / turned.estimate, 1 / turned.high, 1 / turned.low)
    )
    assert found.p == pytest.approx(turned.p)


@pytest.mark.parametrize("count", [5, 20])
def test_the_interval_of_a_ratio_holds_the_truth_in_95_of_100_draws(count: int) -> None:
    rng = RNG(count)
    held = 0
    for _ in range(2000):
        seed_effect = rng.normal(0, 0.5, count)  # what both sides share: the same balls
        ours = 0.7 * np.exp(4.5 + seed_effect + rng.normal(0, 0.2, count))
        theirs = np.exp(4.5 + seed_effect + rng.normal(0, 0.2, count))
        found = paired_ratio(ours, theirs)
        held += found.low <= 0.7 <= found.high
    assert held / 2000 == pytest.approx(0.95, abs=0.015)  # three standard errors


def test_pairing_makes_the_interval_narrower_where_both_sides_share_their_seeds() -> None:
    rng = RNG(5)
    shared = rng.normal(0, 0.5, 20)
    ours, theirs = np.exp(shared + rng.normal(0, 0.1, 20)), np.exp(shared + rng.normal(0, 0.1, 20))
    paired, mixed = paired_ratio(ours, theirs), paired_ratio(ours, rng.permutation(theirs))
    assert math.log(paired.high / paired.low) < 0.5 * math.log(mixed.high / mixed.low)


def test_one_pair_or_none_has_no_interval_and_no_test() -> None:
    one, none = paired_difference(np.array([3.0]), np.array([1.0])), paired_ratio(np.empty(0), np.empty(0))
    assert (one.count, one.estimate) == (1, 2.0) and math.isnan(one.low) and math.isnan(one.p)
    assert none.count == 0 and math.isnan(none.estimate) and math.isnan(none.p)


def test_values_that_do_not_scatter_are_equal_or_not() -> None:
    same, other = paired_difference(np.ones(5), np.ones(5)), paired_difference(np.full(5, 2.0), np.ones(5))
    assert (same.low, same.high, same.p) == (0, 0, 1)
    assert (other.low, other.high, other.p) == (1, 1, 0)


def test_a_ratio_needs_values_above_zero() -> None:
    with pytest.raises(ConfigError, match="above 0"):
        paired_ratio(np.array([1.0, 0.0]), np.array([1.0, 1.0]))


def test_holm_s_adjusted_values_are_the_textbook_s() -> None:
    # The first is the example of R's p.adjust(c(.01, .04, .03, .005), "holm").
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]) == [1.0, 1.0]
    assert holm([0.02]) == [0.02] and holm([]) == []
    with_gap = holm([0.01, math.nan, 0.03])
    assert with_gap[0] == pytest.approx(0.02) and math.isnan(with_gap[1]) and with_gap[2] == pytest.approx(0.03)


def test_holm_keeps_the_chance_of_any_false_claim_below_five_percent() -> None:
    rng = RNG(6)
    families = 1000
    false = sum(min(holm(list(rng.uniform(0, 1, 20)))) < 0.05 for _ in range(families))
    plain = sum(rng.uniform(0, 1, 20).min() < 0.05 for _ in range(families))
    assert false / families < 0.07 and plain / families > 0.5


def test_seeds_are_told_in_runs() -> None:
    assert seeds_as_text([4, 0, 1, 2, 7, 8]) == "0-2, 4, 7-8"
    assert seeds_as_text([]) == "none"
