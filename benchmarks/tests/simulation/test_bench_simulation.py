"""The bench of the simulated cameras, with one small case."""

import pytest

from benchmarks.simulation import bench_simulation
from benchmarks.simulation.bench_simulation import SpeedCase
from core.events import SensorSize


def test_a_row_holds_the_speed_of_both_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    case = SpeedCase("dark", SensorSize(96, 96), 6.0, 2.0)
    monkeypatch.setattr(bench_simulation, "CASES", (case, case))
    monkeypatch.setattr(bench_simulation, "RUNS", 1)
    shares: list[float] = []
    told: list[object] = []

    class Watcher:
        def __call__(self, share: float) -> None:
            shares.append(round(share, 6))

        def row(self, row: object) -> None:
            told.append((row, shares[-1]))

    report = bench_simulation.run(Watcher())
    rows = report["rows"]
    assert isinstance(rows, list)
    assert len(rows) == 2 and shares == [0.3, 0.5, 0.5, 0.8, 1.0, 1.0]  # a row has steps: it may take minutes
    assert told == [(rows[0], 0.5), (rows[1], 1.0)]
    first, second = rows
    assert (first["scene"], first["sensor"], first["speed_mps"]) == ("dark", "96x96", 6.0)
    assert first["events_per_s"] == second["events_per_s"] > 2 * 96 * 96 * 2.0
    for row in rows:
        assert row["one_core"] >= row["one_core_slowest"] > 0 and row["wall"] >= row["wall_slowest"] > 0
        assert row["simulated_s"] == pytest.approx(1.5, abs=1.0) and row["setup_s"] > 0
