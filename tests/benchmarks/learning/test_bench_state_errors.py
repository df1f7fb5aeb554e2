"""The comparison of states: equal samples are near, others far, and what was watched is not watched again."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.learning import bench_state_errors
from benchmarks.learning.bench_state_errors import NAMES, WatchedBall, compare, errors_of
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import draw_serve_batch
from core.learning.task.point_errors import SeenFlight

NOTHING = SeenFlight(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), 0.3)


def balls_of(shift: float) -> list[WatchedBall]:
    timed = draw_serve_batch(5.0, 200, EnvironmentConfig(state_source="timed"), np.random.default_rng(17))
    return [WatchedBall(NOTHING, one + shift) for one in errors_of(timed)]


def test_balls_seen_alike_agree_and_others_do_not() -> None:
    same, other = compare(5.0, balls_of(0.0)), compare(5.0, balls_of(5.0))
    assert isinstance(same["worst"], float) and isinstance(same["by_chance"], float)
    assert same["chain_balls"] == 100 and same["worst"] < 1.2 * same["by_chance"] < 0.25
    assert isinstance(other["worst"], float) and other["worst"] > 0.5 and other["agrees"] is False
    assert {f"ks_{name}" for name in NAMES} <= same.keys()


def test_a_ball_is_watched_once_and_its_points_are_near_the_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench_state_errors, "SPEEDS_MPS", (9.0,))
    monkeypatch.setattr(bench_state_errors, "TIMED_BALLS", 20)
    found = bench_state_errors.run(lambda share: None, folder=tmp_path, count=2)
    (row,) = found["rows"]  # type: ignore[misc]
    assert row["chain_balls"] == 1 and row["chain_seen"] == 1.0
    with np.load(tmp_path / "9mps-0000.npz") as file:
        assert len(file["t_s"]) > 50 and np.abs(file["errors_m"]).max() < 0.02
        assert np.isfinite(file["error"]).all()

    def never(*_: object) -> None:
        raise AssertionError("watched again")

    monkeypatch.setattr(bench_state_errors._Watching, "watch", never)
    assert bench_state_errors.run(lambda share: None, folder=tmp_path, count=2)["rows"] == found["rows"]
