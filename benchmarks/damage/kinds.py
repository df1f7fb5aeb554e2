"""A kind of damage trial: how a whole one is made, how it is damaged, and how the product opens it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.damage.bytes_damage import damage_bytes

Outcome = Literal["good", "noted", "line", "bug", "died", "slow", "memory"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageKind:
    """One row of the bench."""

    name: str
    make: Callable[[Path], None]
    """Write a whole one into an empty folder."""
    damage: Callable[[Path, Path, np.random.Generator], str]
    """Make a damaged copy of that folder in the place of another; what was done."""
    open: Callable[[Path], tuple[str, ...]]
    """As the product does, from the folder; its notes.

    Raises:
        RallyscopeError: the one clear line.
    """


def copy_folder(whole: Path, damaged: Path) -> None:
    """A fresh copy, whatever the last trial has left."""
    shutil.rmtree(damaged, ignore_errors=True)
    shutil.copytree(whole, damaged)


def damage_a_file(whole: Path, damaged: Path, rng: np.random.Generator, *, pattern: str = "**/*") -> str:
    """Byte damage of one of the files."""
    copy_folder(whole, damaged)
    files = sorted(path for path in damaged.glob(pattern) if path.is_file())
    victim = files[int(rng.integers(len(files)))]
    name, data = damage_bytes(victim.read_bytes(), rng)
    victim.write_bytes(data)
    return f"{victim.name}: {name}"
