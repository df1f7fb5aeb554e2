"""Label stores put together into a new one: what annotators disagree about is listed and left out, the rest is merged.

A store holds a layer for each annotator and camera, and so does the merged one. Two annotators are in conflict about a
time of a camera if they say different states, or centres farther apart than they may be. Of what one annotator said of
a time in two stores, the later counts.
"""

from __future__ import annotations

import itertools
import math
import sqlite3
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from urllib.parse import unquote

from core.errors import LabelError
from core.files import replacing
from labels.database.connection import DamagedStoreError, open_to_read, open_to_write, telling, transaction
from labels.database.edit_log import NEWEST, Writer, add_edit, make_layer
from labels.database.folder import Layer
from labels.database.rows import Values, current_rows, label_of
from labels.database.salvage import salvage
from labels.database.schema import recording_of
from labels.model import Label
from labels.store import LabelStore, find_layers

WITHIN_PX: Final = 2.0
"""Two careful people differ by less in 95 of 100 centres."""


@dataclass(frozen=True, slots=True)
class LabelConflict:
    """Two annotators who say different things about one time of one camera."""

    camera: str
    t_us: int
    annotators: tuple[str, str]
    states: tuple[str, str]
    distance_px: float | None
    """Between the centres; None unless both have one."""


@dataclass(frozen=True, slots=True)
class MergedStores:
    """What a merge did."""

    recording_uuid: str
    labels: int
    """In the new store, blind repeats among them."""
    conflicts: tuple[LabelConflict, ...]
    left_out: int
    """Labels that are in conflict, and so not in the new store."""
    superseded: int
    """Labels for which the same annotator said something later in another store."""
    notes: tuple[str, ...]


@dataclass(slots=True)
class _Pile:
    """Labels of all stores by layer and time."""

    labels: dict[Layer, dict[int, Label]] = field(default_factory=lambda: defaultdict(dict))
    superseded: int = 0
    notes: list[str] = field(default_factory=list)

    def add(self, layer: Layer, labels: Iterable[Label]) -> None:
        known = self.labels[layer]
        for label in labels:
            before = known.get(label.t_us)
            self.superseded += before is not None and before != label
            if before is None or before.provenance.made_at_us < label.provenance.made_at_us:
                known[label.t_us] = label


def merge_stores(
    sources: Sequence[Path], out: Path, *, within_px: float = WITHIN_PX, prefer: str | None = None
) -> MergedStores:
    """Put stores of one recording together; a source is a store file, or the folder of a recording's labels.

    In conflicts with `prefer`, that annotator's label is taken and the others' are left out. Of one source alone
    everything is kept: it is copied, and saved if it is damaged.

    Raises:
        LabelError: if a source cannot be read, they are of different recordings, or `out` is there already.
    """
    if out.exists():
        raise LabelError("there is a file already", where=out, remedy="name another one with --out")
    pile, uuids = _Pile(), {}
    for source in sources:
        uuids[source] = _read_source(source, pile)
    if len(set(uuids.values())) != 1:
        told = ", ".join(f"{path} of {uuid}" for path, uuid in uuids.items())
        raise LabelError("these labels are of different recordings", got=told)
    uuid = uuids[sources[0]]
    conflicts = tuple(find_conflicts(pile.labels, within_px)) if len(sources) > 1 else ()
    dropped = {
        (conflict.camera, conflict.t_us, name)
        for conflict in conflicts
        for name in conflict.annotators
        if prefer not in conflict.annotators or name != prefer
    }
    kept = {
        layer: [label for label in labels.values() if layer.blind or not _is_among(dropped, layer, label)]
        for layer, labels in pile.labels.items()
    }
    _write(out, uuid, kept)
    written = sum(map(len, kept.values()))
    left_out = sum(map(len, pile.labels.values())) - written
    return MergedStores(uuid, written, conflicts, left_out, pile.superseded, tuple(pile.notes))


def find_conflicts(labels: dict[Layer, dict[int, Label]], within_px: float) -> list[LabelConflict]:
    """What different annotators say differently, by camera and time. Blind repeats are nobody's word."""
    said: dict[tuple[str, int], list[tuple[str, Label]]] = defaultdict(list)
    for layer in sorted((layer for layer in labels if not layer.blind), key=lambda layer: layer.annotator):
        for t_us, label in labels[layer].items():
            said[layer.camera, t_us].append((layer.annotator, label))
    found = []
    for (camera, t_us), words in sorted(said.items(), key=lambda item: item[0]):
        for (name, one), (other_name, other) in itertools.combinations(words, 2):
            distance = _distance_px(one, other)
            if one.state is not other.state or (distance is not None and distance > within_px):
                states = (one.state.value, other.state.value)
                found.append(LabelConflict(camera, t_us, (name, other_name), states, distance))
    return found


def _distance_px(one: Label, other: Label) -> float | None:
    if one.x_px is None or one.y_px is None or other.x_px is None or other.y_px is None:
        return None
    return math.dist((one.x_px, one.y_px), (other.x_px, other.y_px))


def _is_among(dropped: set[tuple[str, int, str]], layer: Layer, label: Label) -> bool:
    return (layer.camera, label.t_us, layer.annotator) in dropped


def _read_source(source: Path, pile: _Pile) -> str:
    """Add the labels of a store to the pile; the recording that they are of."""
    if source.is_dir():
        uuid = unquote(source.name)
        layers = find_layers(source.absolute().parent, uuid)
        if not layers:
            raise LabelError("no labels in this folder", where=source, remedy="name a labels.sqlite")
        for layer in layers:
            store = LabelStore.read(source.absolute().parent, layer)
            pile.add(layer, store.all())
            pile.notes += [note for note in store.notes if note not in pile.notes]
        return uuid
    if not source.is_file():
        raise LabelError(
            "no such label store", where=source, remedy="name a labels.sqlite, or the folder that it is in"
        )
    try:
        db = open_to_read(source)
        with closing(db):
            return _read_database(db, source, pile)
    except DamagedStoreError:
        db, notes = salvage(source)
        pile.notes += notes
        with closing(db):
            return _read_database(db, source, pile)


def _read_database(db: sqlite3.Connection, path: Path, pile: _Pile) -> str:
    with telling(path, "cannot read the labels"):
        uuid = recording_of(db, path)
        found: list[tuple[Layer, list[Label]]] = []
        notes: list[str] = []
        for number, camera, annotator, blind in db.execute("SELECT * FROM layers").fetchall():
            rows = [(row[0], row[2:]) for row in current_rows(db, number, upto=NEWEST)]
            found.append((Layer(uuid, camera, annotator, bool(blind)), _readable_labels(rows, path, notes)))
    for layer, labels in found:  # only now: a store that breaks off in the middle is read again otherwise
        pile.add(layer, labels)
    pile.notes += notes
    return uuid


def _readable_labels(rows: list[tuple[int, Values]], path: Path, notes: list[str]) -> list[Label]:
    labels = []
    for t_us, values in rows:
        try:
            labels.append(label_of(t_us, values))
        except LabelError as error:
            notes.append(f"{path}: left out: {error}")
    return labels


def _write(out: Path, uuid: str, layers: dict[Layer, list[Label]]) -> None:
    try:
        with replacing(out, durable=True) as partial:
            _fill(partial, out, uuid, layers)
    except OSError as error:
        raise LabelError("cannot write the merged labels", got=error.strerror, where=out) from error


def _fill(partial: Path, out: Path, uuid: str, layers: dict[Layer, list[Label]]) -> None:
    with closing(open_to_write(partial, uuid)) as db, telling(out, "cannot write the merged labels"), transaction(db):
        for layer, labels in layers.items():
            number = make_layer(db, layer.camera, layer.annotator, layer.blind)
            add_edit(db, Writer(number, "", "rallyscope labels merge"), labels, ())
