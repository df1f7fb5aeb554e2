"""The bench of the simulated cameras, with one small case."""

import pytest

from core.evaluation import bench_simulation
from core.evaluation.bench_simulation import Case
from core.events import SensorSize


def test_a_row_holds_the_speed_of_both_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case("dark", SensorSize(96, 96), 6.0, 2.0)
    monkeypatch.setattr(bench_simulation, "CASES", (case, case))
    shares: list[float] = []
    report = bench_simulation.run(shares.append)
    rows = report["rows"]
    assert isinstance(rows, list)
    assert len(rows) == 2 and shares == [0.5, 1.0]
    first, second = rows
    assert (first["scene"], first["sensor"], first["cameras"]) == ("dark", "96x96", 2)
    assert first["events_per_s"] == second["events_per_s"] > 2 * 96 * 96 * 2.0
    assert first["real_time"] * first["cpu_s"] == pytest.approx(second["real_time"] * second["cpu_s"])
