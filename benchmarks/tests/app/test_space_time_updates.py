from __future__ import annotations

from pathlib import Path

from benchmarks.app.space_time_updates import WINDOWS, measure_space
from benchmarks.machine import Row


def test_a_window_of_thirty_thousand_events_is_one_frame_of_nine_bytes_a_point(tmp_path: Path) -> None:
    size, redraws, *rates = measure_space(tmp_path, windows=2)
    assert 262 < _measured(size) < 280 and size["met"], "three half floats and three bytes of colour"
    assert _measured(redraws) == 1
    assert WINDOWS > 2 and all("30,000 points" in str(row["note"]) for row in rates)


def _measured(row: Row) -> float:
    return float(str(row["measured"]))
