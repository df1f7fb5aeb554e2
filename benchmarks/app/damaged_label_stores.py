"""Damage trials of label stores: by bytes, and by SQL that no program of ours would run."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.damage.kinds import DamageKind, copy_folder, damage_a_file
from labels.model import Label, LabelState
from labels.store import LabelStore, Layer

LAYER: Final = Layer("damage-trial", "left", "anna")
LABELS: Final = 60
VALUES: Final = (
    None, -1, 0, 2**62, 1.5, float("inf"), -1e300, "", "ball", "visible", "undo", "x" * 5000, b"\xff\xfe", "../..",
)  # fmt: skip


def _make_store(folder: Path) -> None:
    with LabelStore.open(folder, LAYER.recording_uuid, LAYER.camera, LAYER.annotator) as store:
        for index in range(LABELS):
            store.put(Label(t_us=1000 * index, state=LabelState.VISIBLE, x_px=10.0 + index, y_px=20.5, r_px=5.0))
        store.undo()


def _damage_store(whole: Path, damaged: Path, rng: np.random.Generator) -> str:
    if rng.random() < 0.5:
        return damage_a_file(whole, damaged, rng, pattern="**/labels.sqlite*")
    copy_folder(whole, damaged)
    path = next(damaged.rglob("labels.sqlite"))
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("PRAGMA ignore_check_constraints = 1")
        statement, values = _statement(db, rng)
        try:
            db.execute(statement, values)
        except sqlite3.Error as error:  # strict tables refuse some of it
            return f"{statement}: {error}"
    return f"{statement} {values!r:.60}"


def _statement(db: sqlite3.Connection, rng: np.random.Generator) -> tuple[str, tuple[object, ...]]:
    tables = [row[0] for row in db.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name")]
    table = tables[int(rng.integers(len(tables)))]
    columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
    column = columns[int(rng.integers(len(columns)))]
    value = VALUES[int(rng.integers(len(VALUES)))]
    some = f"WHERE abs(random()) % {int(rng.integers(1, 20))} = 0" if rng.random() < 0.7 else ""
    choices: tuple[tuple[str, tuple[object, ...]], ...] = (
        (f"UPDATE {table} SET {column} = ? {some}", (value,)),
        (f"UPDATE OR IGNORE {table} SET {column} = ? {some}", (value,)),
        (f"UPDATE OR IGNORE {table} SET {column} = {columns[int(rng.integers(len(columns)))]} {some}", ()),
        (f"DELETE FROM {table} {some}", ()),
        (f"ALTER TABLE {table} RENAME TO other", ()),
        (f"ALTER TABLE {table} ADD COLUMN extra", ()),
        (f"CREATE TRIGGER t AFTER INSERT ON {table} BEGIN DELETE FROM {table}; END", ()),
        (f"CREATE VIEW v AS SELECT * FROM {table}", ()),
        (f"PRAGMA user_version = {int(rng.integers(0, 100))}", ()),
        ("PRAGMA application_id = 1", ()),
    )
    return choices[int(rng.choice(len(choices), p=(0.3, 0.2, 0.15, 0.15, *[0.2 / 6] * 6)))]


def _open_store(folder: Path) -> tuple[str, ...]:
    """Read as it is, then labelled on in, as Label does."""
    with LabelStore.read(folder, LAYER) as store:
        found, notes = store.labels(), store.notes
        assert (np.diff(found.t_us) > 0).all()
    with LabelStore.open(folder, LAYER.recording_uuid, LAYER.camera, LAYER.annotator) as store:
        store.labels()
        store.put(Label(t_us=500, state=LabelState.NO_BALL))
        store.undo()
    return tuple(notes)


STORES: Final = DamageKind(name="label store", make=_make_store, damage=_damage_store, open=_open_store)
