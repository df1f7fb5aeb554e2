"""The table of robustness, with few balls."""

import json

import numpy as np
import pytest

from benchmarks.robustness import bench_robustness
from benchmarks.robustness.bench_robustness import CELLS, Cell, PlayedSession, lab_physics
from core.errors import CommandError
from core.jobs.jobs import ALONE
from core.physics.config import physics_profile
from core.trajectory.filter_config import UNKNOWN


def nothing(share: float) -> None:
    assert 0 <= share <= 1


def test_a_row_is_played_kept_and_put_on_the_page(tmp_path) -> None:
    report = tmp_path / "page.md"
    options = {"balls": 1, "only": "nothing-told", "folder": tmp_path, "report": report, "engine": ALONE}
    first = bench_robustness.run(nothing, **options)
    (row,) = first["rows"]
    assert row["returned"] == 1.0 and row["landing_mm_median"] < 300 and row["told"] == ""
    assert row["returned_low"] == pytest.approx(0.207, abs=0.001), "Wilson's interval of 1 of 1"
    (kept,) = tmp_path.glob("nothing-told-*.json")
    page = report.read_text()
    assert "| nothing is wrong | - | 1 | 100 (21-100) | 0/0/0/0 |" in page and "--balls 1" in page
    changed = json.loads(kept.read_text()) | {"returned": [False], "cases": ["net"], "landing_m": [None]}
    kept.write_text(json.dumps(changed))
    (row,) = bench_robustness.run(nothing, **options)["rows"]
    assert row["returned"] == 0.0 and row["net"] == 1, "what is in the folder is not played again"


def test_a_row_that_is_not_there_is_one_line() -> None:
    with pytest.raises(CommandError, match="no such row"):
        bench_robustness.run(nothing, only="gravity")


def test_rows_count_what_came_of_the_balls_and_say_what_is_told() -> None:
    sessions = [
        PlayedSession((True, False), ("returned", "net"), (0.1, None), 1.5),
        PlayedSession((True, True), ("returned", "returned"), (0.2, 0.3), -1.9),
    ]
    row = bench_robustness._row(CELLS[0], sessions)
    assert (row["balls"], row["returned"], row["net"], row["missed"]) == (4, 0.75, 1, 0)
    assert row["landing_mm_median"] == pytest.approx(200) and row["told"] == "air, table"
    assert row["latency_error_ms"] == -1.9


def test_the_constants_of_a_lab_are_off_as_the_row_says_up_or_down() -> None:
    real = physics_profile("real")
    found = set()
    for seed in range(20):
        cell = Cell(name="", words="", constant="friction", sigmas=2)
        lab = lab_physics(cell, real, np.random.default_rng(seed))
        assert lab.air.drag_coefficient == UNKNOWN["drag"] and lab.table.restitution == UNKNOWN["restitution"]
        found.add(round((lab.table.friction - UNKNOWN["friction"]) / UNKNOWN["friction_sigma"], 6))
        assert lab.rubber == real.rubber
    assert found == {-2.0, 2.0}
    drawn = [lab_physics(CELLS[1], real, np.random.default_rng(seed)).air.drag_coefficient for seed in range(40)]
    assert np.std(drawn) == pytest.approx(UNKNOWN["drag_sigma"], rel=0.4)
