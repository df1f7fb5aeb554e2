"""Damage trials of the index of a data set, and of what is trained on by it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from benchmarks.damage.kinds import DamageKind, copy_folder, damage_a_file
from benchmarks.damage.sample_recording import write_sample_recording
from benchmarks.damage.text_kinds import SAMPLE_MANIFEST
from core.data_sets.event_windows import EventWindows
from core.data_sets.index import INDEX, SCHEMA, write_index
from core.recordings import open_recording

FILES: Final = ("ball-6mps-side-1.h5", "ball-7mps-side-1.h5")
ABSURD: Final = (
    "", "../ball-6mps-side-1.h5", "/etc/passwd", "a" * 5000, "a\0b.h5", -1, 2**63 - 1, float("nan"), None, [], b"x",
)  # fmt: skip


def _make(folder: Path) -> None:
    entries = []
    for name in FILES:
        write_sample_recording(folder / name)
        with open_recording(folder / name) as recording:
            uuid, duration_us = recording.uuid, recording.duration_us
        (sample,) = SAMPLE_MANIFEST["recordings"]  # type: ignore[misc]
        settings = {"scene_changes": {"wall": 0.5}, "sensor": "96x72", "noise_hz": 0.1, "physics": "paper"}
        facts = {"file": name, "uuid": uuid, "sha256": 64 * "0", "duration_us": duration_us}
        entries.append({**sample, **facts, "settings": {**sample["settings"], **settings}})
    write_index(folder, {**SAMPLE_MANIFEST, "recordings": entries})


def _damage(whole: Path, damaged: Path, rng: np.random.Generator) -> str:
    """Half by the meaning of the table, half by its bytes."""
    if rng.random() < 0.5:
        return damage_a_file(whole, damaged, rng, pattern=INDEX)
    copy_folder(whole, damaged)
    with parquet.ParquetFile(damaged / INDEX) as file:
        table = file.read()
    name = SCHEMA.names[int(rng.integers(len(SCHEMA.names)))]
    place = table.schema.get_field_index(name)
    act = ("gone", "absurd", "another", "twice", "no rows", "swapped")[int(rng.integers(6))]
    if act == "gone":
        table = table.remove_column(place)
    elif act == "absurd":
        value = ABSURD[int(rng.integers(len(ABSURD)))]
        act = f"{act} {value!r:.20}"
        table = table.set_column(place, name, pa.array([value] * len(table)))
    elif act == "another":
        other = SCHEMA.names[int(rng.integers(len(SCHEMA.names)))]
        table = table.set_column(place, name, table.column(other))
    elif act == "twice":
        table = pa.concat_tables([table, table])
    elif act == "no rows":
        table = table.slice(0, 0)
    else:
        table = table.set_column(place, name, table.column(name).take([1, 0]))
    parquet.write_table(table, damaged / INDEX)
    return f"{name} {act}"


def _open(folder: Path) -> tuple[str, ...]:
    windows = EventWindows(folder, only_with_ball=False)
    for number in (0, -1) if len(windows) else ():
        windows[number]
    windows.close()
    return ()


INDEXES: Final = DamageKind(name="index of a data set", make=_make, damage=_damage, open=_open)
