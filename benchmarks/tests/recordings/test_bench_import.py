"""The bench of imports, with small counts: its file is a true one, and its rows have every figure."""

from __future__ import annotations

import numpy as np
from faery import evt

from benchmarks.recordings import bench_import


def test_the_rows_hold_the_figures_and_no_event_or_trigger_is_lost(monkeypatch):
    monkeypatch.setattr(bench_import, "SHORT_EVENTS", 50_000)
    monkeypatch.setattr(bench_import, "LONG_EVENTS", 1_000_000)
    monkeypatch.setattr(bench_import, "SLICES", 5)
    shares: list[float] = []
    report = bench_import.run(shares.append)
    rows = report["rows"]
    assert isinstance(rows, list)
    assert [row["measure"] for row in rows[4:]] == [
        "EVT3 import", "EVT3 import, CPU", "EVT3 import, peak memory", "EVT3 import, triggers kept", "50 ms slice",
        "EVT3 decoding", "EVT3 decoding by faery", "EVT3 decoding, ours to faery's",
    ]  # fmt: skip
    assert all(row["median"] > 0 for row in rows)
    assert [row["median"] for row in rows if "triggers" in row["measure"]] == [1.0, 1.0]
    assert rows[6]["median"] < 300
    assert shares[-1] == 1.0


def test_the_file_it_imports_is_what_other_programs_read(tmp_path):
    path = tmp_path / "a.raw"
    bench_import.write_evt3(path, 100_000)
    with evt.Decoder(path, (1, 1), None) as decoder:
        assert decoder.dimensions == (1280, 720)
        packets = list(decoder)
    times = np.concatenate([packet["events"]["t"] for packet in packets if "events" in packet]).astype(np.int64)
    assert len(times) == 100_000
    assert times[0] >= 10_000 and times[-1] < 30_000 and (np.diff(times) >= 0).all()
    assert sum(len(packet["triggers"]) for packet in packets if "triggers" in packet) == 40
