"""The physics bench with small counts: the same code that `rallyscope bench` runs with large ones."""

from __future__ import annotations

import pytest

from benchmarks.physics.bench_physics import compare_physics, soft_drops, soft_episodes, throughput, untrained_returns
from core.physics.task import task_profile


@pytest.mark.parametrize("profile", ["paper", "real"])
def test_closed_form_and_mujoco_agree_in_the_bench(profile: str) -> None:
    row = compare_physics(task_profile("paper" if profile == "paper" else "real"), 4.0, 0.01, 15)
    assert row["same_case_dt_10ms"] == 1.0
    assert isinstance(row["landing_max_mm_dt_10ms"], float) and row["landing_max_mm_dt_10ms"] < 1.0


def test_the_figures_of_the_bench_are_of_the_expected_size() -> None:
    returns = untrained_returns(task_profile("paper"), 5.0, 2000)
    assert returns["zero_action_returned"] == pytest.approx(0.57, abs=0.05)
    speed = throughput(2000)
    assert all(isinstance(value, (int, float)) and value > 0 for value in speed.values())
    assert len(speed) == 6
    drops = soft_drops("table", 0.0005, 20)
    assert drops["restitution_mean"] == pytest.approx(0.90, abs=0.02)
    assert 0 < float(str(soft_episodes(5.0, 10)["landing_median_mm"])) < 300
