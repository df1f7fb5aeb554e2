"""The labels of one recording, one camera and one annotator: every acknowledged edit is on the disk.

Each such layer is a file of its own, `<folder>/<recording uuid>/<camera>/<annotator>.jsonl`. One writer per file means
that annotators never wait for or damage each other, that a layer is handed over by copying one file, and that the cost
of a label does not depend on how many others have made. A recording may be read-only, so labels are not kept in it.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Self
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import ArrayLike

from core.errors import LabelError
from labels.arrays import LabelArrays, label_arrays
from labels.edits import Edit, EditHistory
from labels.journal import Journal, JournalLines, read_journal
from labels.model import Label, LabelState
from labels.records import SCHEMA, Json, label_from_json, label_to_json

FORMAT = "rallyscope-labels"
SUFFIX = ".jsonl"
BLIND_SUFFIX = ".blind.jsonl"
_FEW_CHANGES = 64
"""Up to so many changes are worked into the sorted columns one by one (about 1 ms each at 200,000 labels); more are
sorted anew."""


@dataclass(frozen=True, slots=True)
class Layer:
    """Whose labels of what: the identity of a store. With `t_us` it is the identity of a label."""

    recording_uuid: str
    camera: str
    annotator: str
    blind: bool = False
    """The annotator's second look, made without seeing the first: it measures the annotator's own noise."""

    def path(self, folder: Path) -> Path:
        """Where its journal is; names of any script are percent-encoded into plain file names."""
        suffix = BLIND_SUFFIX if self.blind else SUFFIX
        return folder / _plain(self.recording_uuid) / _plain(self.camera) / f"{_plain(self.annotator)}{suffix}"


@dataclass(frozen=True, slots=True)
class LabelProgress:
    """How far a set of times has been worked through."""

    total: int
    checked: int
    by_state: Mapping[LabelState, int]

    @property
    def unchecked(self) -> int:
        """Times that nobody looked at."""
        return self.total - self.checked


class LabelStore:
    """A layer of labels that is open for reading and writing. Safe to use from several threads.

    When a method that changes something returns, the change is on the disk; when it raises, nothing has changed.
    """

    def __init__(self, layer: Layer, path: Path, lines: JournalLines, journal: Journal | None, tool: str) -> None:
        self.layer = layer
        self.path = path
        self._tool = tool
        self._journal = journal
        self._lock = threading.RLock()
        self._history, self._seq, self.notes = _replay(lines, layer, path)
        self._arrays = label_arrays(self._history.labels.values())
        self._stale: set[int] = set()
        if journal is not None and not lines.whole:
            self._write({"op": "open", "schema": SCHEMA, "format": FORMAT, **_identity(layer)})

    @classmethod
    def open(
        cls, folder: Path, recording_uuid: str, camera: str, annotator: str, *, blind: bool = False, tool: str = ""
    ) -> Self:
        """Open a layer for writing, starting it if it is new. `tool` is noted in every label made here.

        Raises:
            LabelError: if it cannot be written, another process writes it, or it belongs to something else.
        """
        layer = Layer(recording_uuid, camera, annotator, blind)
        for name, value in (("recording", recording_uuid), ("camera", camera), ("annotator", annotator)):
            if not value.strip():
                raise LabelError(f"labels need a name of the {name}", got=repr(value))
        path = layer.path(folder)
        journal, lines = Journal.open(path)
        try:
            return cls(layer, path, lines, journal, tool)
        except BaseException:
            journal.close()
            raise

    @classmethod
    def read(cls, folder: Path, layer: Layer) -> Self:
        """A layer as it is now, for reading only: from a read-only disk, or while another process writes it.

        Raises:
            LabelError: if there is none, or it cannot be read.
        """
        path = layer.path(folder)
        if not path.is_file():
            raise LabelError("no labels", got=f"nothing by {layer.annotator!r} for {layer.camera!r}", where=path)
        return cls(layer, path, read_journal(path), None, "")

    @property
    def version(self) -> int:
        """Grows with every change: compare it to know whether somebody else changed something."""
        with self._lock:
            return self._seq

    @property
    def can_undo(self) -> bool:
        with self._lock:
            return self._history.undoable is not None

    @property
    def can_redo(self) -> bool:
        with self._lock:
            return self._history.redoable is not None

    def put(self, label: Label) -> None:
        """Add or replace the label at its time."""
        self.edit(put=(label,))

    def delete(self, t_us: int) -> bool:
        """Make a time unchecked again; False if it was already."""
        return self.edit(delete=(t_us,)) > 0

    def edit(self, *, put: Iterable[Label] = (), delete: Iterable[int] = ()) -> int:
        """Several changes as one: one write, one step of undo, all or nothing. Returns how many times it touches.

        Raises:
            LabelError: if it is not saved.
        """
        with self._lock:
            gone = tuple(t_us for t_us in dict.fromkeys(delete) if t_us in self._history.labels)
            stamped = tuple(self._stamp(label) for label in put)
            if not gone and not stamped:
                return 0
            times = {label.t_us for label in stamped}
            if len(times) != len(stamped) or times & set(gone):
                raise LabelError("one edit says two things about the same time", where=self.path)
            edit = Edit(self._seq + 1, stamped, gone)
            self._write({"op": "edit", "put": [label_to_json(label) for label in stamped], "delete": list(gone)})
            return self._note(self._history.apply(edit))

    def undo(self) -> tuple[int, ...]:
        """Take back the latest edit, also of an earlier session; returns the times it touched, () if none is left."""
        with self._lock:
            if self._history.undoable is None:
                return ()
            self._write({"op": "undo", "of": self._history.undoable})
            touched = self._history.undo()
            self._note(touched)
            return touched

    def redo(self) -> tuple[int, ...]:
        """Bring back the edit that was undone last; returns the times it touched, () if there is none."""
        with self._lock:
            if self._history.redoable is None:
                return ()
            self._write({"op": "redo", "of": self._history.redoable})
            touched = self._history.redo()
            self._note(touched)
            return touched

    def at(self, t_us: int) -> Label | None:
        """The label at exactly this time; None: unchecked."""
        with self._lock:
            return self._history.labels.get(t_us)

    def labels(self) -> LabelArrays:
        """All labels as sorted columns: a snapshot that does not change."""
        with self._lock:
            labels = self._history.labels
            if len(self._stale) > _FEW_CHANGES:
                self._arrays = label_arrays(labels.values())
            else:
                for t_us in self._stale:
                    self._arrays = self._arrays.changed(t_us, labels.get(t_us))
            self._stale.clear()
            return self._arrays

    def all(self) -> tuple[Label, ...]:
        """All labels with their provenance, by time."""
        with self._lock:
            return tuple(label for _, label in sorted(self._history.labels.items()))

    def by_time(self) -> Mapping[int, Label]:
        """All labels by their time, in no order: a snapshot that does not change."""
        with self._lock:
            return MappingProxyType(dict(self._history.labels))

    def progress(self, t_us: ArrayLike) -> LabelProgress:
        """How many of these times are labelled, and how."""
        times = np.unique(np.asarray(t_us, np.int64)).tolist()
        with self._lock:
            found = [label.state for t in times if (label := self._history.labels.get(t)) is not None]
        return LabelProgress(len(times), len(found), Counter(found))

    def next_unchecked(self, t_us: ArrayLike, after_us: int) -> int | None:
        """The first of these times behind `after_us` that has no label; goes round to the start once."""
        times = np.unique(np.asarray(t_us, np.int64))
        unchecked = times[~np.isin(times, self.labels().t_us)]
        if not len(unchecked):
            return None
        row = int(np.searchsorted(unchecked, after_us, side="right"))
        return int(unchecked[row % len(unchecked)])

    def close(self) -> None:
        """Let go of the file. Nothing is written: everything is saved already."""
        with self._lock:
            if self._journal is not None:
                self._journal.close()
                self._journal = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _stamp(self, label: Label) -> Label:
        made = label.provenance
        return replace(
            label,
            provenance=replace(
                made,
                annotator=made.annotator or self.layer.annotator,
                made_at_us=made.made_at_us or time.time_ns() // 1000,
                tool=made.tool or self._tool,
            ),
        )

    def _write(self, record: Json) -> None:
        if self._journal is None:
            raise LabelError("these labels are open for reading only", where=self.path)
        self._journal.append({"seq": self._seq + 1, **record})
        self._seq += 1

    def _note(self, touched: tuple[int, ...]) -> int:
        self._stale.update(touched)
        return len(touched)


def find_layers(folder: Path, recording_uuid: str | None = None) -> tuple[Layer, ...]:
    """Every layer in a folder of labels, by recording, camera and annotator."""
    above = _plain(recording_uuid) if recording_uuid is not None else "*"
    layers = []
    for path in folder.glob(f"{above}/*/*{SUFFIX}"):
        blind = path.name.endswith(BLIND_SUFFIX)
        stem = path.name.removesuffix(BLIND_SUFFIX if blind else SUFFIX)
        layers.append(Layer(unquote(path.parent.parent.name), unquote(path.parent.name), unquote(stem), blind))
    return tuple(sorted(layers, key=lambda layer: (layer.recording_uuid, layer.camera, layer.annotator, layer.blind)))


def _plain(name: str) -> str:
    # A full stop is encoded too: no name can then be "..", nor end like the suffix of a blind layer.
    return quote(name, safe="").replace(".", "%2E")


def _identity(layer: Layer) -> dict[str, object]:
    return {
        "recording": layer.recording_uuid,
        "camera": layer.camera,
        "annotator": layer.annotator,
        "blind": layer.blind,
    }


def _replay(lines: JournalLines, layer: Layer, path: Path) -> tuple[EditHistory, int, tuple[str, ...]]:
    """The state a journal leads to, the number of its last line, and what was wrong with it."""
    history, seq = EditHistory(), 0
    notes = [f"{path}:{number}: damaged line, left out" for number in lines.damaged]
    for record in lines.records:
        number = record.get("seq")
        seq = max(seq, number) if isinstance(number, int) else seq
        match record.get("op"):
            case "open":
                _check_header(record, layer, path)
            case "edit":
                history.apply(_edit_of(record, path))
            case "undo" if record.get("of") == history.undoable:
                history.undo()
            case "redo" if record.get("of") == history.redoable:
                history.redo()
            case "undo" | "redo":
                notes.append(f"{path}: {record['op']} of edit {record.get('of')}, which is damaged; left out")
            case other:
                raise LabelError("unknown operation", got=repr(other), where=path, remedy="use a later version")
    return history, seq, tuple(notes)


def _check_header(record: Json, layer: Layer, path: Path) -> None:
    schema = record.get("schema")
    if record.get("format") != FORMAT or not isinstance(schema, int) or schema > SCHEMA:
        got = f"{record.get('format')} schema {schema}"
        raise LabelError(
            "labels of another version", expected=f"{FORMAT} up to {SCHEMA}", got=got, where=path, remedy="update"
        )
    found = {name: record.get(name) for name in _identity(layer)}
    if found != _identity(layer):
        raise LabelError("labels of something else", expected=_identity(layer), got=found, where=path)


def _edit_of(record: Json, path: Path) -> Edit:
    seq, put, delete = record.get("seq"), record.get("put"), record.get("delete")
    if not isinstance(seq, int) or not isinstance(put, list) or not isinstance(delete, list):
        raise LabelError("not an edit", got=sorted(record), where=path)
    try:
        return Edit(seq, tuple(label_from_json(values) for values in put), tuple(int(t_us) for t_us in delete))
    except LabelError as error:
        raise LabelError(str(error), where=f"{path} edit {seq}") from error
