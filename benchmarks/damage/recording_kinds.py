"""Damage trials of recordings: by what HDF5 means, by bytes, and of the log of a killed writer."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import h5py
import numpy as np

from benchmarks.damage.hdf5_damage import ELSEWHERE, damage_hdf5
from benchmarks.damage.kinds import DamageKind, copy_folder, damage_a_file
from benchmarks.damage.open_recording_whole import open_recording_whole
from benchmarks.damage.sample_recording import write_elsewhere, write_sample_recording

FILE: Final = "sample.h5"


def _make(folder: Path) -> None:
    write_sample_recording(folder / FILE)
    write_elsewhere(folder / ELSEWHERE)


def _make_log(folder: Path) -> None:
    write_sample_recording(folder / FILE, close=False)


def _damage_meaning(whole: Path, damaged: Path, rng: np.random.Generator) -> str:
    copy_folder(whole, damaged)
    with h5py.File(damaged / FILE, "r+") as file:
        return damage_hdf5(file, rng)


def _damage_bytes(whole: Path, damaged: Path, rng: np.random.Generator) -> str:
    return damage_a_file(whole, damaged, rng, pattern=FILE)


def _open(folder: Path) -> tuple[str, ...]:
    return open_recording_whole(folder / FILE)


MEANING: Final = DamageKind(name="recording, by its meaning", make=_make, damage=_damage_meaning, open=_open)
BYTES: Final = DamageKind(name="recording, by its bytes", make=_make, damage=_damage_bytes, open=_open)
LOG: Final = DamageKind(name="recording of a killed writer", make=_make_log, damage=_damage_bytes, open=_open)
