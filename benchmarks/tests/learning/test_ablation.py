"""The ablation with tiny counts: rows differ, seeds are kept, and the page has every row."""

from pathlib import Path

import pytest
import tomli_w

from benchmarks.learning import runs as learning_runs
from benchmarks.learning.ablation import CHANGES, experiments, run
from core.config import config_to_mapping
from core.errors import ConfigError
from core.learning.config import RunConfig


def test_every_row_is_another_training_and_a_change_is_one_part_of_the_run() -> None:
    rows = {one.name: one.config for one in experiments(1)}
    assert len({learning_runs.fingerprint(config) for config in rows.values()}) == len(rows)
    for name in CHANGES:
        changed = config_to_mapping(rows[f"paper + {name}"])
        parts = {part for part, value in config_to_mapping(rows["paper"]).items() if changed[part] != value}
        assert len(parts) == 1 and parts <= {"ddpg", "exploration"}


def test_a_seed_is_trained_once_and_the_page_has_its_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows, page, asked = experiments(2, shorten=100), tmp_path / "page.md", ("paper", "placing")
    results = run(rows, tmp_path / "runs", page, asked)
    assert [one.seed for one in results["placing"]] == [31_000, 31_001]
    lines = [line for line in page.read_text().splitlines() if line.startswith("| ")]
    assert [line.split(" | ")[:2] for line in lines[2:]] == [["| paper", "2"], ["| placing", "2"]]
    assert "2 seeds" in lines[-1]

    def never(*_: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr(learning_runs, "run_training", never)
    assert run(rows, tmp_path / "runs", page, asked) == results
    with pytest.raises(ConfigError, match="no such row"):
        run(rows, tmp_path / "runs", page, ("plaicng",))


def test_settings_that_came_later_do_not_rename_earlier_results(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed: list[dict[str, dict[str, object]]] = []
    monkeypatch.setattr(tomli_w, "dumps", lambda mapping: hashed.append(mapping) or "")
    learning_runs.fingerprint(RunConfig())
    assert "batch" in hashed[0]["ddpg"] and not {"rewards", "final_rate"} & hashed[0]["ddpg"].keys()
