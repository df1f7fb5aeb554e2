"""The robot's clock against ours by pings, and a session's by when its blocks arrive."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from core.robot.robot_watch import RobotClock
from core.robot.source_with_robot import SessionClock


def ping(clock: RobotClock, at_us: float, there_us: float, back_us: float, offset_us: float) -> bool:
    return clock.add(at_us, at_us + there_us + back_us, at_us + there_us + offset_us)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.floats(50, 30_000), st.floats(50, 30_000)), min_size=3, max_size=60))
def test_the_offset_is_known_within_what_it_says(delays) -> None:
    clock = RobotClock()
    assert all(ping(clock, 50_000.0 * k, *delay, -7e9) for k, delay in enumerate(delays))
    found = clock.estimate
    assert found is not None and abs(found.offset_us + 7e9) <= found.within_us + 1e-3
    assert found.within_us <= min(sum(delay) for delay in delays[-40:]) / 2 + 1e-3
    assert abs(found.host_us(found.robot_us(123456.0)) - 123456.0) <= 0.5


def test_fifty_parts_in_a_million_are_no_jump_and_five_milliseconds_are() -> None:
    clock, rng = RobotClock(), np.random.default_rng(1)
    for k in range(2400):
        assert ping(clock, 50_000.0 * k, *rng.uniform(100, 900, 2), 50e-6 * 50_000 * k)
    assert clock.jumps == 0 and clock.estimate is not None
    assert abs(clock.estimate.offset_us - 50e-6 * 50_000 * 2400) < 1000
    assert not ping(clock, 1.3e8, 500, 500, 6000 + 6500)
    assert clock.jumps == 1 and clock.estimate is None, "nothing is known of the new one yet"
    assert all(ping(clock, 1.3e8 + 1e5 * k, 500, 500, 12_500) for k in (1, 2))
    assert clock.estimate is not None and abs(clock.estimate.offset_us - 12_500) < 600


def test_the_session_is_where_the_quickest_block_of_the_last_second_says() -> None:
    clock, rng = SessionClock(), np.random.default_rng(2)
    assert clock.host_us(0) is None and clock.session_us(0) is None
    for k in range(1, 300):
        t_us = 10_000 * k
        clock.add(t_us, 5e9 + t_us + rng.exponential(3000))
    gone = clock.host_us(3_000_000)
    assert gone is not None and 0 <= gone - 5e9 - 3_000_000 < 400
    assert abs((clock.session_us(gone) or 0) - 3_000_000) < 1e-3
    for k in range(300, 420):  # the replay was late and goes on 200 ms later
        clock.add(10_000 * k, 5e9 + 200_000 + 10_000 * k)
    assert clock.host_us(4_000_000) == 5e9 + 4_200_000
