"""The step test finds what the example robot, in a process of its own, was made late by, and the player leads by it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from core.chain.control.step_test import CommandLatency
from core.errors import NoAnswerError, TargetRefusedError
from core.robot import RobotClient, RobotLimits, latency_test, measure_robot
from core.robot.latency_test import STEP_M, _aside, _takes_s
from tests.core.robot.limits import LIMITS
from tests.waiting import eventually


@pytest.mark.parametrize("late_ms", [0.0, 35.0])
def test_what_the_motors_are_late_by_is_found_within_2_ms(late_robot, late_ms: float, monkeypatch) -> None:
    monkeypatch.setattr(latency_test, "TRIES", 20)  # a busy machine sees fewer of them whole
    done: list[float] = []
    with late_robot(1e-3 * late_ms) as client:
        home, before = np.array(client.status.state.p_m), client.status.counts

        def measured() -> CommandLatency | None:
            nonlocal before
            before = client.status.counts
            try:
                return measure_robot(client, progress=done.append, steps=8)
            except (NoAnswerError, TargetRefusedError):  # an answer that is late on a busy machine ends it
                return None

        found = eventually(measured, "a test that is not broken off", lambda: client.status)
        counts, clock = client.status.counts, client.status.clock
        steps = np.array([one.p_m for one in client.states_since(0)]) - home
    assert clock is not None  # the figure is as good as the clocks, and as the steps are alike, on a busy machine
    assert 1e3 * found.mean_s == pytest.approx(late_ms, abs=2.0 + 4e3 * found.sigma_s + 1e-3 * clock.within_us)
    assert found.steps == 8 <= counts.taken - before.taken and done[-1] == 1.0 and counts.refused == before.refused
    assert np.ptp(steps[:, 1]) == pytest.approx(STEP_M, abs=0.002) and np.abs(steps[:, [0, 2]]).max() < 0.001


def test_it_ends_at_once_when_it_must_not_go_on_and_when_the_robot_is_stopped(late_robot) -> None:
    with late_robot(0.0) as client:
        with pytest.raises(TargetRefusedError, match="a ball flies"):
            measure_robot(client, lambda: "a ball flies")
        assert client.status.counts.sent == 0
        taken = 0

        def ended_by_a_ball() -> bool:
            nonlocal taken
            taken = client.status.counts.taken
            return "a ball flies" in why_it_ended(
                client, lambda: "a ball flies" if client.status.counts.taken >= taken + 2 else ""
            )

        eventually(ended_by_a_ball, "a ball that comes after two steps to end it", lambda: client.status)
        assert client.status.counts.taken == taken + 2
        sent = client.status.counts.sent
        client.stop("a visitor is too near")
        with pytest.raises(TargetRefusedError, match="a visitor is too near"):
            measure_robot(client)
        assert client.status.counts.sent == sent


def why_it_ended(client: RobotClient, refuse: Callable[[], str]) -> str:
    """Reason that ended a step test: the one of `refuse`, or, on a busy machine, a late answer."""
    with pytest.raises((NoAnswerError, TargetRefusedError)) as ended:
        measure_robot(client, refuse)
    return str(ended.value)


def test_steps_stay_within_the_limits_or_are_not_taken() -> None:
    inside = np.array([-1.6, 0.98, 0.25])
    np.testing.assert_allclose(_aside(LIMITS, inside), [0.0, -STEP_M, 0.0])
    narrow = RobotLimits(
        low_m=(-2.2, -0.01, 0.02), high_m=(-1.0, 0.01, 0.9), max_speed_mps=0.1, max_acceleration_mps2=2.0,
        max_turn_rate_radps=20.0,
    )  # fmt: skip
    np.testing.assert_allclose(_aside(narrow, np.array([-1.6, 0.0, 0.25])), [0.0, 0.0, STEP_M])
    takes_s = _takes_s(narrow, STEP_M)
    assert 1.5 * STEP_M / takes_s <= 0.05 + 1e-9 and 6 * STEP_M / takes_s**2 <= 1.0 + 1e-9
    with pytest.raises(TargetRefusedError, match=r"by its limits a step of 4 cm takes 4.0 s"):
        _takes_s(replace(narrow, max_speed_mps=0.03), STEP_M)
    with pytest.raises(TargetRefusedError, match="leaves no room"):
        _aside(replace(narrow, high_m=(-2.19, 0.01, 0.03)), np.array([-2.195, 0.0, 0.025]))
