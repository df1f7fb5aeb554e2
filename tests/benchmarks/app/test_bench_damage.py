"""A sample of the trials of `bench damage`: no damage of any file of ours is a bug. And the trials find what is one."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks.app.bench_damage import KINDS, choose_kinds, rows_of
from benchmarks.damage.kinds import DamageKind
from benchmarks.damage.trial_child import open_damaged
from benchmarks.damage.trials import DamageCounts, run_damage_trials
from core.errors import CommandError, RecordingError

SAMPLE = 25


@pytest.mark.parametrize("name", KINDS)
def test_a_sample_of_damages_is_no_bug(name: str, tmp_path: Path) -> None:
    module, attribute = KINDS[name].split(":")
    kind: DamageKind = getattr(importlib.import_module(module), attribute)
    (tmp_path / "whole").mkdir()
    kind.make(tmp_path / "whole")
    assert kind.open(tmp_path / "whole") is not None
    for number in range(SAMPLE):
        what = kind.damage(tmp_path / "whole", tmp_path / "damaged", np.random.default_rng((7, number)))
        outcome, said = open_damaged(kind, tmp_path / "damaged")
        assert outcome in ("good", "noted", "line"), f"{what}: {said}"


def _open_badly(folder: Path) -> tuple[str, ...]:
    number = int(folder.joinpath("number").read_text())
    if number == 1:
        raise KeyError("u_px")
    if number == 2:
        os.abort()
    if number == 3:
        bytearray(1 << 45)
    if number == 4:
        raise RecordingError("one clear line")
    return ()


def _number(whole: Path, damaged: Path, rng: np.random.Generator) -> str:
    damaged.mkdir(exist_ok=True)
    counter = damaged.parent.parent / f"rallyscope-trial-counter-{os.getppid()}"
    number = int(counter.read_text()) if counter.exists() else 0
    counter.write_text(str(number + 1))
    damaged.joinpath("number").write_text(str(number))
    if number == 4:
        counter.unlink()
    return f"number {number}"


def _make(folder: Path) -> None:
    folder.joinpath("number").write_text("0")


BAD = DamageKind(name="bad", make=_make, damage=_number, open=_open_badly)


def test_bugs_deaths_and_memory_are_found_and_the_trials_go_on() -> None:
    counts = run_damage_trials("tests.benchmarks.app.test_bench_damage:BAD", 5, seed=1)
    assert dict(counts.outcomes) == {"good": 1, "bug": 1, "died": 1, "memory": 1, "line": 1}
    assert any(place.startswith("bug: KeyError") for place in counts.problems)


def test_a_bug_misses_the_goal() -> None:
    counts = DamageCounts()
    for outcome in ("good", "line", "bug"):
        counts.add({"trial": 0, "outcome": outcome, "said": "", "seconds": 0.1})
    bugs, deaths, slow = rows_of("config", counts)
    assert (bugs["measured"], bugs["met"]) == (1.0, False) and deaths["met"] and slow["met"]


def test_one_kind_is_asked_for_by_its_name() -> None:
    assert choose_kinds("manifest") == {"manifest": KINDS["manifest"]} and choose_kinds(None) == KINDS
    with pytest.raises(CommandError, match="no such kind of file"):
        choose_kinds("pictures")
