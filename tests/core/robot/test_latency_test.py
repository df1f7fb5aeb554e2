"""The step test finds what the example robot, in a process of its own, was made late by, and the player leads by it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from core.errors import NoAnswerError, TargetRefusedError
from core.robot import RobotLimits, latency_test, measure_robot
from core.robot.latency_test import STEP_M, _aside, _takes_s
from tests.core.robot.limits import LIMITS


@pytest.mark.parametrize("late_ms", [0.0, 35.0])
def test_what_the_motors_are_late_by_is_found_within_2_ms(late_robot, late_ms: float, monkeypatch) -> None:
    monkeypatch.setattr(latency_test, "TRIES", 20)  # a busy machine sees fewer of them whole
    done: list[float] = []
    with late_robot(1e-3 * late_ms) as client:
        home = np.array(client.status.state.p_m)
        found, before = None, client.status.counts
        for _ in range(5):
            with suppress(NoAnswerError, TargetRefusedError):  # an answer that is late on a busy machine ends it
                before = client.status.counts
                found = measure_robot(client, progress=done.append, steps=8)
                break
        counts = client.status.counts
        steps = np.array([one.p_m for one in client.states_since(0)]) - home
    assert found is not None and 1e3 * found.mean_s == pytest.approx(late_ms, abs=2.0)
    assert found.steps == 8 <= counts.taken - before.taken and done[-1] == 1.0 and counts.refused == before.refused
    assert np.ptp(steps[:, 1]) == pytest.approx(STEP_M, abs=0.002) and np.abs(steps[:, [0, 2]]).max() < 0.001


def test_it_ends_at_once_when_it_must_not_go_on_and_when_the_robot_is_stopped(late_robot) -> None:
    with late_robot(0.0) as client:
        with pytest.raises(TargetRefusedError, match="a ball flies"):
            measure_robot(client, lambda: "a ball flies")
        assert client.status.counts.sent == 0
        with pytest.raises(TargetRefusedError, match="a ball flies"):  # one that comes later
            measure_robot(client, lambda: "a ball flies" if client.status.counts.taken >= 2 else "")
        assert client.status.counts.sent == 2
        client.stop("a visitor is too near")
        with pytest.raises(TargetRefusedError, match="a visitor is too near"):
            measure_robot(client)
        assert client.status.counts.sent == 2


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
