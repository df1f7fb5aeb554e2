"""Every `rallyscope bench` that a page or a docstring gives for a figure runs, with its smallest counts.

Minutes in all. `tests/docs/test_commands.py` checks in the gate that all of them are understood.
"""

from __future__ import annotations

import importlib
import inspect
import json
from pathlib import Path

import pytest

from app.cli.bench import BENCHES, load_from_checkout
from app.cli.main import main
from core.cameras import save_calibration
from core.cameras.presets import CORNERS, camera_preset
from tests.docs.test_commands import shown_commands

pytestmark = [pytest.mark.slow, pytest.mark.long]
HERE = Path(__file__).parent
SMALLEST = {"--count": "1", "--balls": "1", "--trials": "1", "--speeds": "5"}
CONSTANTS: dict[str, dict[str, object]] = {
    "balls": {"BALLS": 100, "BALLS_OF_RECORDING": 10, "REPEATS": 1},
    "cameras": {"SCENES": ("ball",), "SPEEDS_MPS": (5.0,)},
    "detection": {"CASES": (("paper", 0.1),), "SPEEDS_MPS": (5.0,), "WINDOWS_TIMED": 5},
    "export": {"SECONDS": 1, "SERVES": 1},
    "labels": {
        "KILLS": 2, "MANY": 2000, "ANNOTATORS": 2, "STORED": (0, 1000), "OPERATIONS": 100, "SNAPS": 12,
        "RALLIES": 2, "DRAWS": 2,
    },
    "prediction": {"PER_SPEED": 2},
    "rally": {"LATENCY_TURNS": 1, "LATENCY_TURN_S": 1.0},
    "rig": {},
    "slow-receptors": {"CUTOFFS_HZ": (300.0,)},
}  # fmt: skip
"""The benches that are run here, and the constants of those whose counts are no options."""
ELSEWHERE = {
    "app": "app/test_return_in_browser.py",
    "drawn-scenes": "detection/test_bench_drawn_scenes.py",
    "first-balls": "rally/test_bench_first_balls.py",
    "import": "recordings/test_bench_import.py",
    "learning": "learning/test_bench_learning.py",
    "outcomes": "rally/test_bench_outcomes.py",
    "paper-perception": "perception/test_bench_paper_perception.py",
    "planet": "detection/test_bench_planet.py",
    "rivals": "detection/test_bench_rivals.py",
    "robustness": "robustness/test_bench_robustness.py",
    "simulation": "simulation/test_bench_simulation.py",
    "single-views": "detection/test_bench_single_views.py",
}
"""Benches whose own test runs them with small counts: of parts that they choose, or with files that they draw."""
COMMANDS = sorted(
    {shown.words for _, shown in shown_commands() if shown.words[0] == "bench" and shown.words[1] in BENCHES}
)


def smallest(words: tuple[str, ...], folder: Path) -> list[str]:
    """A documented command with its smallest counts, and with files in a folder."""
    given = dict(SMALLEST)
    taken = inspect.signature(load_from_checkout(BENCHES[words[1]]).run).parameters
    files = {"--folder": folder / "kept", "--report": folder / "page.md", "--rig": folder / "rig.yaml"}
    given |= {name: str(path) for name, path in files.items()}
    found, before = [], ""
    for word in words:
        found.append(given.get(before, word))
        before = word
    added = [name for name in (*SMALLEST, "--folder") if name[2:] in taken and name not in words]
    return [
        *found,
        *(text for name in added for text in (name, given[name])),
        *([] if "--json" in words else ["--json"]),
    ]


def test_every_bench_that_is_documented_is_run_here_or_by_its_own_test() -> None:
    assert {words[1] for words in COMMANDS} == {*CONSTANTS, *ELSEWHERE}
    assert [name for name in ELSEWHERE.values() if not (HERE / name).exists()] == []


@pytest.mark.parametrize("words", [words for words in COMMANDS if words[1] in CONSTANTS], ids=" ".join)
def test_a_documented_bench_runs_and_has_figures(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = importlib.import_module(f"benchmarks.{BENCHES[words[1]]}")
    for name, value in CONSTANTS[words[1]].items():
        assert hasattr(module, name)
        monkeypatch.setattr(module, name, value)
    save_calibration(tmp_path / "rig.yaml", camera_preset(CORNERS))
    asked = smallest(words, tmp_path)
    assert main(asked) == 0
    report = json.loads(capsys.readouterr().out)
    figures = [report["pace"]] if "pace" in words else report["rows"]
    assert figures and all(figures)
    assert (tmp_path / "page.md").exists() == ("--report" in asked)
