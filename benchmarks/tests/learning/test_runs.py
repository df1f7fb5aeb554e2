"""Paired comparisons: known answers, and scipy as the reference."""

import math

import numpy as np
import pytest
from scipy import stats

from benchmarks.learning.runs import pair_by_seed, paired_difference, seeds_as_text
from core.errors import ConfigError


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
    rng = np.random.default_rng(1)
    ours, theirs = rng.normal(70, 20, 20), rng.normal(90, 20, 20)
    found = paired_difference(ours, theirs)
    expected = stats.ttest_rel(ours, theirs)
    interval = expected.confidence_interval(0.95)
    assert (found.count, found.estimate) == (20, pytest.approx(np.mean(ours - theirs)))
    assert (found.low, found.high) == pytest.approx((interval.low, interval.high))


def test_one_pair_or_none_has_no_interval() -> None:
    one, none = paired_difference(np.array([3.0]), np.array([1.0])), paired_difference(np.empty(0), np.empty(0))
    assert (one.count, one.estimate) == (1, 2.0) and math.isnan(one.low)
    assert none.count == 0 and math.isnan(none.estimate)


def test_values_that_do_not_scatter_are_equal_or_not() -> None:
    same, other = paired_difference(np.ones(5), np.ones(5)), paired_difference(np.full(5, 2.0), np.ones(5))
    assert (same.low, same.high) == (0, 0)
    assert (other.low, other.high) == (1, 1)


def test_seeds_are_told_in_runs() -> None:
    assert seeds_as_text([4, 0, 1, 2, 7, 8]) == "0-2, 4, 7-8"
    assert seeds_as_text([]) == "none"
