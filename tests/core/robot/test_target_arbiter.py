"""However late, often or out of order messages arrive, nothing stale is carried out, and nothing after a stop."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from core.robot.motion_check import AHEAD_US, FOLLOW_US, OLDEST_US, SILENT_US, FaceMotion, TargetArbiter
from core.robot.robot_messages import RobotTarget
from tests.core.robot.limits import LIMITS

REST = FaceMotion.of((-1.6, 0.0, 0.25), (1, 0, 0, 0), (0, 0, 0))


def target(number: int, sent_us: int, lead_us: int = 400_000, valid_us: int = 100_000, y_m: float = 0.1) -> RobotTarget:
    return RobotTarget(
        id=number, sent_us=sent_us, valid_until_us=sent_us + valid_us, impact_us=sent_us + lead_us,
        p_m=(-1.42, y_m, 0.3), q_wxyz=(1.0, 0.0, 0.0, 0.0), v_mps=(2.0, 0.0, 0.0),
    )  # fmt: skip


def started() -> TargetArbiter:
    keeper = TargetArbiter(LIMITS)
    assert keeper.start(1)
    keeper.hear(0)
    return keeper


def why(keeper: TargetArbiter, wanted: RobotTarget, now_us: int) -> str:
    fault = keeper.offer(wanted, REST, now_us)
    return "" if fault is None else fault.why


def test_it_begins_stopped_and_takes_nothing_before_it_is_started() -> None:
    keeper = TargetArbiter(LIMITS)
    assert why(keeper, target(1, 0), 0) == "stopped" and keeper.target(0) is None
    assert keeper.start(2) and why(keeper, target(3, 0), 1000) == ""


def test_a_target_is_followed_until_its_impact_is_over() -> None:
    keeper, wanted = started(), target(2, 0)
    assert why(keeper, wanted, 2000) == ""
    for now_us in (2000, 400_000, 400_000 + FOLLOW_US):
        keeper.hear(now_us)
        assert keeper.target(now_us) is wanted
    assert keeper.target(400_001 + FOLLOW_US) is None and keeper.target(300_000) is None


def test_what_was_under_way_for_too_long_is_not_begun() -> None:
    keeper = started()
    assert why(keeper, target(2, 0), 100_001) == "stale"
    assert why(keeper, target(3, 0, valid_us=10**9), OLDEST_US + 1) == "stale", "whatever it says of itself"
    assert why(keeper, target(4, 0, lead_us=50_000, valid_us=10**9), 60_000) == "late"
    assert keeper.target(200_000) is None


def test_an_older_target_does_not_replace_a_newer_one() -> None:
    keeper, newer = started(), target(5, 1000, y_m=0.2)
    assert why(keeper, newer, 2000) == ""
    assert why(keeper, target(4, 1500), 2500) == "older" and why(keeper, newer, 2600) == "older"
    assert keeper.target(3000) is newer


def test_a_target_that_is_refused_makes_those_before_it_old_and_leaves_the_one_that_is_followed() -> None:
    keeper, first = started(), target(2, 0)
    assert why(keeper, first, 0) == ""
    assert why(keeper, target(9, 0, y_m=3.0), 0) == "bounds" and why(keeper, target(8, 0), 0) == "older"
    assert keeper.target(0) is first


def test_a_target_of_a_clock_that_is_ahead_is_refused() -> None:
    keeper = started()
    assert why(keeper, target(2, AHEAD_US + 1), 0) == "clock" and why(keeper, target(3, AHEAD_US), 0) == ""


def test_nothing_of_before_a_stop_is_carried_out_after_it() -> None:
    keeper = started()
    assert why(keeper, target(2, 0), 0) == ""
    keeper.stop("rallyscope", "enough", 4)
    assert keeper.target(1) is None and why(keeper, target(5, 0), 1) == "stopped"
    assert not keeper.start(3), "it was sent before the stop"
    assert (keeper.stopped, keeper.reason) == ("rallyscope", "enough")
    assert keeper.start(7) and keeper.target(2) is None
    assert why(keeper, target(6, 0), 3) == "older" and why(keeper, target(8, 0), 3) == ""


def test_a_target_is_dropped_when_nobody_is_heard_or_the_clock_runs_backwards() -> None:
    keeper = started()
    assert why(keeper, target(2, 0, lead_us=900_000), 0) == ""
    assert keeper.target(SILENT_US) is not None and keeper.target(SILENT_US + 1) is None
    keeper.hear(600_000)
    assert why(keeper, target(3, 600_000), 600_000) == "" and keeper.target(610_000) is not None
    assert keeper.target(609_000) is None


def test_another_commander_finds_it_stopped_and_counts_from_one() -> None:
    keeper = started()
    assert why(keeper, target(50, 0), 0) == ""
    keeper.begin_anew()
    assert keeper.stopped and keeper.target(0) is None and why(keeper, target(1, 0), 0) == "stopped"
    assert keeper.start(2) and why(keeper, target(3, 0), 0) == ""


ACTS = st.sampled_from(["target", "target", "target", "stop", "start"])


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(ACTS, st.integers(0, 400_000), st.integers(0, 2)), min_size=3, max_size=30))
def test_delayed_repeated_and_reordered_messages_never_make_it_carry_out_what_is_stale(plan) -> None:
    """One message every 20 ms, each delayed by up to 400 ms, some lost, some twice."""
    keeper = TargetArbiter(LIMITS)
    arrivals: list[tuple[int, int, str]] = []
    for index, (act, delay_us, copies) in enumerate(plan):
        arrivals += [(20_000 * index + delay_us + 5000 * copy, index + 1, act) for copy in range(copies)]
    newest, stopped, began_us = 0, True, {}
    for now_us, number, act in sorted(arrivals):
        sent_us = 20_000 * (number - 1)
        keeper.hear(now_us)
        if act == "stop":
            keeper.stop("rallyscope", "", number)
            stopped = True
        elif act == "start":
            was_taken = keeper.start(number)
            stopped = stopped and not was_taken
        elif keeper.offer(target(number, sent_us, lead_us=900_000), REST, now_us) is None:
            assert number > newest and not stopped and now_us <= sent_us + 100_000
            began_us[number] = now_us
        newest = max(newest, number)
        followed = keeper.target(now_us)
        assert followed is None or (not stopped and followed.id in began_us)
        assert followed is None or followed.id == max(began_us), "the newest that was taken"
