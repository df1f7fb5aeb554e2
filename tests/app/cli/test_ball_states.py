"""`rallyscope evaluate --ball-states`."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.physics.ball_states import KEYS
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves


@pytest.fixture
def states(tmp_path: Path) -> Path:
    """Drawn serves, as the file has them: the table along y."""
    serves = draw_serves(6.0, 6, task_profile("real"), np.random.default_rng(0))
    p, v = serves.ps_m, serves.vs_mps
    rows = np.column_stack([-p[:, 1], p[:, 0], p[:, 2], -v[:, 1], v[:, 0], v[:, 2], np.zeros((6, 3))])
    path = tmp_path / "states.json"
    path.write_text(json.dumps([dict(zip(KEYS, map(float, row), strict=True)) for row in rows]))
    return path


def test_it_says_how_many_come_back_and_writes_a_page(states: Path, tmp_path: Path, capsys) -> None:
    page = tmp_path / "page.md"
    assert main(["evaluate", "--ball-states", str(states), "--report", str(page), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"][0]["returned"] == found["files"][0]["count"] == 6 and found["losses"] == {"states": {}}
    assert "rallyscope evaluate --ball-states states.json --physics real" in page.read_text()
    assert main(["evaluate", "--ball-states", str(states), "--sample", "2"]) == 0
    assert "6 to 7 m/s" in capsys.readouterr().out
    assert main(["evaluate", "--ball-states", str(states), "--hit", "chosen", "--report", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"][0]["returned"] == 6
    assert "--physics real --hit chosen" in page.read_text() and "where the hit may be chosen" in page.read_text()


def test_what_is_asked_for_must_be_one_thing_and_possible(states: Path, tmp_path: Path, capsys) -> None:
    bad = tmp_path / "bad.json"
    bad.write_text("[]")
    for arguments, words in (
        ([], "RUN"),
        (["a-run", "--ball-states", str(states)], "RUN"),
        (["--ball-states", str(bad)], "bad.json"),
        (["--ball-states", str(states), "--told-after-ms", "-1"], "--told-after-ms"),
        (["--ball-states", str(states), "--report", str(tmp_path / "no" / "page.md")], "--report"),
        (["--ball-states", str(states), "--report", str(tmp_path / "page.txt")], "--report"),
    ):
        assert main(["evaluate", *arguments]) == 2
        error = capsys.readouterr().err
        assert words in error and error.count("\n") == 1
