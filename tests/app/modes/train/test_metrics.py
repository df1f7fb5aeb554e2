"""Reading files that grow, and that get shorter when a killed run is resumed."""

import json

import numpy as np
import pytest

from app.shared.training_records import FILES_KEPT, RECENT, MetricsReader, MetricsStore, last_line
from app.shared.workspace import Workspace
from core.errors import ConfigError
from core.learning.runs.run_files import read_lines, seed_files


def test_every_line_is_a_row(trained: Workspace) -> None:
    run = trained.run_path("small")
    lines, _ = read_lines(seed_files(run, 0).metrics)
    metrics = MetricsReader(run, 0).read()
    assert len(metrics) == len(lines) == 40
    for name in ("case", "reward", "noise", "w1"):
        assert metrics.columns[name] == pytest.approx([line[name] for line in lines])
    assert metrics.landings_m[7] == pytest.approx(lines[7]["landing_m"])
    assert metrics.goals_m[7] == pytest.approx(lines[7]["goal_m"])
    assert metrics.recent == tuple(lines[-RECENT:])
    assert [line["episode"] for line in metrics.evaluations] == list(range(4, 41, 4))


def test_a_growing_file_gives_the_same_as_one_read_at_once(trained: Workspace, tmp_path) -> None:
    source = seed_files(trained.run_path("small"), 0).metrics.read_bytes()
    target = seed_files(tmp_path, 0)
    target.folder.mkdir()
    reader = MetricsReader(tmp_path, 0)
    assert len(reader.read()) == 0
    for end in (10, 3000, 3001, 20_000, len(source)):
        target.metrics.write_bytes(source[:end])
        metrics = reader.read()
        assert len(metrics) == source[:end].count(b"\n")
    whole = MetricsReader(trained.run_path("small"), 0).read()
    assert all(np.array_equal(metrics.columns[k], v, equal_nan=True) for k, v in whole.columns.items())
    assert metrics.recent == whole.recent


def test_a_file_that_got_shorter_is_read_anew(tmp_path) -> None:
    files = seed_files(tmp_path, 0)
    files.folder.mkdir()
    lines = [json.dumps({"case": 4, "reward": k, "landing_m": [0.5, 0.0]}) for k in range(10)]
    files.metrics.write_text("\n".join(lines) + "\n")
    reader = MetricsReader(tmp_path, 0)
    assert len(reader.read()) == 10
    files.metrics.write_text("\n".join(lines[:4]) + "\n")
    assert reader.read().columns["reward"].tolist() == [0, 1, 2, 3]


def test_what_is_not_known_is_nan(tmp_path) -> None:
    files = seed_files(tmp_path, 0)
    files.folder.mkdir()
    files.metrics.write_text(json.dumps({"case": 5, "error_mm": None, "landing_m": [None, None]}) + "\n")
    metrics = MetricsReader(tmp_path, 0).read()
    assert np.isnan(metrics.columns["error_mm"]).all() and np.isnan(metrics.landings_m).all()


def test_a_store_keeps_what_was_asked_for_lately(tmp_path) -> None:
    store = MetricsStore()
    for seed in range(FILES_KEPT + 5):
        assert len(store.read(tmp_path, seed)) == 0
    assert len(store._readers) == FILES_KEPT


def test_the_last_complete_line_is_found_without_reading_the_rest(tmp_path) -> None:
    file = tmp_path / "lines.jsonl"
    assert last_line(file) is None
    for written, expected in ((b'{"a"', None), (b": 1}\n" + b'{"a": 2}\n' * 1000, {"a": 2}), (b'{"a": 3', {"a": 2})):
        with file.open("ab") as handle:
            handle.write(written)
        assert last_line(file) == expected


def test_what_something_else_has_written_is_said_in_one_line(tmp_path) -> None:
    files = seed_files(tmp_path, 0)
    files.folder.mkdir()
    files.metrics.write_text("no json\n")
    with pytest.raises(ConfigError, match="broken line"):
        MetricsReader(tmp_path, 0).read()
