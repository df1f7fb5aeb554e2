"""A machine that is too slow settles on a pace that it can keep, and finds back when it can."""

import itertools

import pytest

from core.live.link.adaptive_rate import FIRST_TRIAL_BLOCKS, LOOK_S, MAX_TRIAL_BLOCKS, SHARES, AdaptiveRate, pace_words

BLOCK_S = 0.01


def run(pace: AdaptiveRate, seconds: float, cost: float) -> list[float]:
    """Simulate for so long on the wall, a block costing `cost` times its length; the shares at every change."""
    shares, passed_s = [], 0.0
    while passed_s < seconds:
        length_s = BLOCK_S / pace.share
        worked_s = cost * BLOCK_S
        took_s = max(length_s, worked_s)
        passed_s += took_s
        if pace.note(length_s, worked_s, took_s):
            shares.append(pace.share)
    return shares


@pytest.mark.parametrize(
    ("cost", "settled"), [(0.5, 1.0), (1.05, 1.0), (1.3, 0.75), (1.9, 0.5), (3.0, 1 / 3), (20.0, 1 / 24)]
)
def test_it_settles_on_the_largest_share_that_can_be_kept(cost: float, settled: float) -> None:
    pace = AdaptiveRate()
    changes = run(pace, 30.0, cost)
    assert pace.share == settled and changes == sorted(changes, reverse=True), "straight down, no to and fro"


def test_it_never_stands_still() -> None:
    pace = AdaptiveRate()
    run(pace, 60.0, 1000.0)
    assert pace.share == SHARES[-1]


def test_one_slow_second_is_no_reason_to_slow_down_but_two_are() -> None:
    pace = AdaptiveRate()
    assert not run(pace, 0.99 * LOOK_S, 1.3)
    assert not run(pace, 3 * LOOK_S, 0.5), "a hiccup"
    assert run(pace, 3 * LOOK_S, 1.3) == [0.75]


def test_it_finds_back_to_the_whole_speed_when_the_machine_is_free_again() -> None:
    pace = AdaptiveRate()
    run(pace, 10.0, 3.0)
    assert pace.share == 1 / 3
    assert run(pace, 2 * FIRST_TRIAL_BLOCKS * LOOK_S, 0.2) == [1.0], "at once, its work is that little"


def test_it_tries_no_pace_that_it_has_no_time_for() -> None:
    pace = AdaptiveRate()
    run(pace, 10.0, 6.0)
    assert pace.share == 1 / 6
    assert run(pace, 4 * FIRST_TRIAL_BLOCKS * LOOK_S, 1.5) == [0.5], "3/4 of the speed would take more than it has"


def test_tries_that_fail_become_rare() -> None:
    """Easy enough to tempt it, and yet too much at the next pace: that happens when the load comes and goes."""
    pace, tries_at_s, now_s = AdaptiveRate(), [], 0.0
    run(pace, 5.0, 1.5)
    while now_s < 400.0:
        before = pace.share
        run(pace, LOOK_S, 0.3 if before < 1.0 else 1.5)
        now_s += LOOK_S
        if pace.share > before:
            tries_at_s.append(now_s)
    gaps = [later - earlier for earlier, later in itertools.pairwise(tries_at_s)]
    assert len(gaps) >= 3 and gaps == sorted(gaps) and gaps[-1] >= 0.8 * MAX_TRIAL_BLOCKS


def test_another_wish_is_tried_at_once() -> None:
    pace = AdaptiveRate()
    run(pace, 10.0, 3.0)
    pace.ask_anew()
    assert pace.share == 1.0


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1.0, "real time"), (0.75, "3/4 speed"), (0.5, "1/2 speed"), (1 / 3, "1/3 speed"), (1 / 64, "1/64 speed"),
     (0.1, "1/10 speed"), (0.3, "0.3 x real time"), (4.0, "4 x real time")],
)  # fmt: skip
def test_a_pace_in_words(factor: float, words: str) -> None:
    assert pace_words(factor) == words
