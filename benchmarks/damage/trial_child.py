"""The child process of damage trials: makes and opens one damaged file after the other, and tells of each.

A line of JSON goes to standard output before each trial (`{"trial": n}`) and after it (with what came of it).
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

import numpy as np

from benchmarks.damage.kinds import DamageKind, Outcome
from core.errors import RallyscopeError

MEMORY_BYTES = 2 << 30
"""On top of what the process has when the trials begin."""


def run_trials(kind: DamageKind, seed: int, first: int, count: int) -> None:
    """Trials number `first` to `count` - 1; each depends on nothing but the seed and its number."""
    with tempfile.TemporaryDirectory(prefix="rallyscope-damage-") as folder:
        pristine, damaged = Path(folder) / "whole", Path(folder) / "damaged"
        pristine.mkdir()
        kind.make(pristine)
        kind.open(pristine)  # a whole one opens, and everything is imported and compiled
        _limit_memory()
        for number in range(first, count):
            _tell({"trial": number})
            told = _one_trial(kind, pristine, damaged, np.random.default_rng((seed, number)))
            _tell({"trial": number, **told})


def _tell(facts: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(facts) + "\n")
    sys.stdout.flush()


def _one_trial(kind: DamageKind, pristine: Path, damaged: Path, rng: np.random.Generator) -> dict[str, object]:
    what = kind.damage(pristine, damaged, rng)
    begun_s = time.perf_counter()
    outcome, said = open_damaged(kind, damaged)
    return {"outcome": outcome, "said": said, "damage": what, "seconds": time.perf_counter() - begun_s}


def open_damaged(kind: DamageKind, damaged: Path) -> tuple[Outcome, str]:
    """What comes of opening it, and the note, the line, or the place of the bug."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            notes = kind.open(damaged)
        return ("noted", notes[-1]) if notes else ("good", "")
    except RallyscopeError as error:
        return ("line", str(error)) if "\n" not in str(error) and len(str(error)) < 1500 else ("bug", str(error)[:300])
    except MemoryError as error:
        return "memory", _place_of(error)
    except Exception as error:  # noqa: BLE001 (the trial is there to find any of them)
        return "bug", _place_of(error)


def _place_of(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if {"core", "labels", "app"} & set(Path(frame.filename).parts)]
    places = " < ".join(f"{Path(frame.filename).stem}:{frame.lineno}" for frame in reversed(ours[-3:]))
    return f"{type(error).__name__} at {places}: {' '.join(str(error).split())[:120]}"


def _limit_memory() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    module, name = sys.argv[1].split(":")
    run_trials(getattr(importlib.import_module(module), name), *map(int, sys.argv[2:5]))
