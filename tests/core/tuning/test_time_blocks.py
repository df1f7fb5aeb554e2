"""The split of a recording in time."""

import numpy as np
import pytest

from core.errors import RecordingError
from core.tuning.objective import cut_blocks

BALLS_US = np.arange(0, 1_000_000, 1000)


def test_no_time_is_on_both_sides_and_each_side_has_half_of_the_balls() -> None:
    blocks = cut_blocks(BALLS_US, 20, 0)
    tuned, held_out = blocks.tuned(BALLS_US), blocks.held_out(BALLS_US)
    assert not (tuned & held_out).any() and (tuned | held_out).all()
    assert tuned.sum() == held_out.sum() == 500


def test_the_beginning_of_a_block_is_on_neither_side() -> None:
    blocks = cut_blocks(BALLS_US, 20, 10_000)  # of 50 ms each
    kept = blocks.tuned(BALLS_US) | blocks.held_out(BALLS_US)
    assert kept[:50].all(), "nothing is before the first"
    assert not kept[50:60].any() and kept[60:100].all() and not kept[100:110].any()


def test_a_gap_takes_no_more_than_a_third_of_a_block() -> None:
    blocks = cut_blocks(BALLS_US, 20, 1_000_000)
    kept = blocks.tuned(BALLS_US) | blocks.held_out(BALLS_US)
    assert 0.6 < kept.mean() < 0.75


def test_blocks_follow_the_balls_and_not_the_silence_between_serves() -> None:
    serves = np.concatenate([start + np.arange(0, 100_000, 1000) for start in (0, 5_000_000, 9_000_000)])
    blocks = cut_blocks(serves, 12, 0)
    for start in (0, 5_000_000, 9_000_000):
        serve = start + np.arange(0, 100_000, 1000)
        assert 0 < blocks.tuned(serve).sum() < 100, "each serve is on both sides"


@pytest.mark.parametrize("period", [2, 3, 4, 5, 6])
def test_serves_at_a_steady_pace_do_not_have_their_beginnings_on_one_side(period: int) -> None:
    blocks = cut_blocks(BALLS_US, 20, 0)
    phase = BALLS_US // 50_000 % period
    for one in range(period):
        assert 0.19 <= blocks.tuned(BALLS_US[phase == one]).mean() <= 0.81


def test_times_outside_the_balls_belong_to_the_first_and_the_last_block() -> None:
    blocks = cut_blocks(BALLS_US + 500_000, 2, 100_000)
    first, last = (500_000, 1_499_000)
    assert blocks.tuned(np.array([-5, 499_999])).tolist() == [bool(blocks.tuned(np.array([first])))] * 2
    assert blocks.tuned(np.array([5_000_000])) == blocks.tuned(np.array([last])) != blocks.tuned(np.array([first]))


def test_few_balls_make_fewer_blocks_and_too_few_are_refused() -> None:
    few = cut_blocks(np.arange(8) * 1000, 20, 10_000)
    assert len(few.starts_us) == 2
    with pytest.raises(RecordingError, match="too few ball positions; expected 8 or more, got 7"):
        cut_blocks(np.arange(7), 20, 0)


def test_empty_times_are_on_no_side() -> None:
    assert cut_blocks(BALLS_US, 20, 0).tuned(np.empty(0, np.int64)).shape == (0,)
