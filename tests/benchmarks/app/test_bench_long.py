"""The bench of a long recording on a short one: every figure is there, and the file's clock may begin anew."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.app import bench_long
from core.recordings import import_recording, open_recording

GOALS = (
    "import of", "import, per", "import, peak", "opening", "a picture of W", "a picture of T", "scoring t", "scoring e",
    "memory",
)  # fmt: skip


def test_every_figure_of_a_recording_is_measured_against_its_goal() -> None:
    rows = bench_long.run(lambda share: None, count=200_000)["rows"]
    assert isinstance(rows, list)
    assert all(row["what"].startswith(goal) for row, goal in zip(rows, GOALS, strict=True)), rows
    assert all(np.isfinite(row["measured"]) for row in rows)


def test_turns_of_the_clock_follow_on_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench_long, "RATE_PER_US", 0.01)
    monkeypatch.setattr(bench_long, "TURN_EVENTS", int(0.01 * bench_long.CLOCK_US))
    monkeypatch.setattr(bench_long, "PIECE_EVENTS", 40_000)
    assert bench_long.whole_turns(1000) == 1000
    count = bench_long.whole_turns(3 * bench_long.TURN_EVENTS - 5)
    assert count == 3 * bench_long.TURN_EVENTS
    bench_long.write_long_evt3(tmp_path / "long.raw", count)
    import_recording([tmp_path / "long.raw"], tmp_path / "long.h5")
    with open_recording(tmp_path / "long.h5") as recording:
        (stream,) = recording.cameras.values()
        assert stream.event_count == count
        assert abs(recording.duration_us - 3 * bench_long.CLOCK_US) < 1000
        turn = stream.slice(bench_long.CLOCK_US, bench_long.CLOCK_US + 10**6).x_px
        assert len(turn) and np.array_equal(
            turn, stream.slice(2 * bench_long.CLOCK_US, 2 * bench_long.CLOCK_US + 10**6).x_px
        )
