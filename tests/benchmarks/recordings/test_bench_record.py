"""The benchmark of recording accounts for every event."""

from benchmarks.recordings.bench_record import measure_recording


def test_a_second_of_a_camera_is_kept_or_counted(tmp_path):
    rows = measure_recording(tmp_path, 1, 1_000_000, lambda share: None)
    kept, unaccounted, lost, _, _ = rows
    assert unaccounted["measured"] == 0 and unaccounted["met"]
    assert kept["measured"] + lost["measured"] / 10_000 == 100.0 and kept["measured"] > 50
