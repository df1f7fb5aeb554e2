import numpy as np
import pytest

from core.chain.config import TrackGateConfig
from core.chain.track_gate import TrackGate

pytestmark = pytest.mark.numeric


def path(count: int, speed_mps: float = -5.0) -> list[tuple[int, np.ndarray]]:
    return [(2000 * k, np.array([1.0 + speed_mps * 0.002 * k, 0.0, 0.3])) for k in range(count)]


def test_a_flight_begins_once_and_goes_on() -> None:
    gate = TrackGate(TrackGateConfig())
    assert [gate.judge(*point) for point in path(50)] == ["new flight"] + ["same flight"] * 49


@pytest.mark.parametrize("strays", [1, 2])
def test_strays_change_nothing(strays: int) -> None:
    gate = TrackGate(TrackGateConfig())
    points = path(20)
    for point in points[:10]:
        gate.judge(*point)
    for number in range(strays):
        assert gate.judge(20_000 + 100 * number, np.array([0.0, 0.7, 1.5])) == "stray"
    assert gate.judge(*points[11]) == "same flight"


def test_a_ball_elsewhere_that_stays_is_a_new_flight_but_scattered_strays_are_not() -> None:
    gate = TrackGate(TrackGateConfig())
    for point in path(10):
        gate.judge(*point)
    elsewhere = [(20_000 + 2000 * k, np.array([2.0 - 0.01 * k, 0.5, 0.6])) for k in range(4)]
    assert [gate.judge(*point) for point in elsewhere] == ["stray", "stray", "new flight", "same flight"]
    gate = TrackGate(TrackGateConfig())
    for point in path(10):
        gate.judge(*point)
    scattered = [(20_000 + 2000 * k, np.array([0.0, 0.0, 0.0]) + (-1) ** k * np.array([0, 2.0, 1.0])) for k in range(6)]
    assert {gate.judge(*point) for point in scattered} == {"stray"}


def test_a_silence_begins_a_new_flight() -> None:
    gate = TrackGate(TrackGateConfig(gap_ms=50.0))
    assert gate.judge(0, np.zeros(3)) == "new flight"
    assert gate.judge(50_000, np.zeros(3)) == "same flight"
    assert gate.judge(100_001, np.zeros(3)) == "new flight"


def test_a_ball_that_comes_back_was_struck_until_the_next_flight() -> None:
    gate = TrackGate(TrackGateConfig())
    for point in path(100):
        last = point
        gate.judge(*point)
    back = [(last[0] + 2000 * k, last[1] + [0.0125 * k, 0, 0]) for k in range(1, 20)]
    assert [gate.judge(*point) for point in back] == ["same flight"] * 4 + ["struck"] * 15
    assert gate.judge(back[-1][0] + 500_000, np.array([1.0, 0, 0.3])) == "new flight"
