"""The labels of one recording, one camera and one annotator: every acknowledged edit is on the disk.

All layers of a recording are in one SQLite file, `<folder>/<recording uuid>/labels.sqlite`, to which any number of
programs may write at the same time; in a folder of a network one program may, and others read. A recording may be
read-only, so labels are not kept in it.
"""

from __future__ import annotations

import sqlite3
import threading
import time
import weakref
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.errors import LabelError
from labels.arrays import SOURCES, LabelArrays, LabelsByTime, label_arrays
from labels.database.connection import (
    DamagedStoreError,
    open_to_read,
    open_to_write,
    sqlite_errors,
    transaction,
    work_in_log,
)
from labels.database.contact_rows import (
    DeletedTimes,
    contact_of,
    current_contacts,
    current_rejections,
    deleted_times,
)
from labels.database.edit_log import (
    SessionHistory,
    UndoStep,
    Writer,
    add_edit,
    add_rejection,
    current_rejected,
    find_layer,
    make_layer,
    newest_edit,
    step_back,
)
from labels.database.folder import Layer
from labels.database.migration import migrate
from labels.database.reading import find_annotators, find_layers, has_labels, read_with_journal, salvage
from labels.database.rows import (
    changes_since,
    current_arrays,
    current_rows,
    label_of,
    times_by_others,
    value_at,
    values_before_settling,
)
from labels.database.schema import recording_of
from labels.database.snapshot import Snapshot
from labels.model import ContactLabel, Label, LabelState, PositionSource

__all__ = ["LabelProgress", "LabelStore", "Layer", "UndoStep", "find_annotators", "find_layers", "has_labels"]
AnyLabel = TypeVar("AnyLabel", Label, ContactLabel)
_FEW_CHANGES = 64
"""Up to so many changes are worked into the sorted columns one by one (about 1 ms each at 200,000 labels); more are
read anew."""
_NOT_SAVED = "everything before it is safe; make room or fix the disk, then repeat it"


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


@dataclass(frozen=True, slots=True, eq=False)
class IndependentLabels:
    """What an annotator said before seeing another's label, and where that cannot be known."""

    labels: LabelArrays
    """Where a label settles a conflict, or a merge left it out, the newest one before that; left out if there is none.
    Labels taken over from another annotator have the source *imported*."""
    settled_us: NDArray[np.int64]
    """Times of the labels that settle a conflict, and of those that a merge left out, ascending."""
    copied_us: NDArray[np.int64]
    """Times of the labels that name another annotator than the layer's, ascending."""


class LabelStore:
    """A layer of labels that is open for reading and writing. Safe to use from several threads.

    When a method that changes something returns, the change is on the disk; when it raises, nothing has changed. What
    other programs write into the layer is seen by the next call.
    """

    def __init__(self, layer: Layer, path: Path, reader: sqlite3.Connection, notes: tuple[str, ...] = ()) -> None:
        self.layer = layer
        self.path = path
        self.notes = notes
        self.is_damaged = False
        """Whether it is what could be read of a damaged file; `notes` says so."""
        self._reader = reader
        # A store that is only dropped closes its file, too.
        self._finalizers = [weakref.finalize(self, reader.close)]
        self._writer: sqlite3.Connection | None = None
        self._follows = False
        """Whether what others write is taken up."""
        self.writer = Writer(0, "", "")
        """Who writes here."""
        self._history = SessionHistory()
        self._lock = threading.RLock()
        """Guards what is read."""
        self._write_lock = threading.Lock()
        self._history_lock = threading.Lock()
        self._change_mark = -1
        self._seen = 0
        self._arrays = label_arrays(())
        with sqlite_errors(path, "cannot read the labels"):
            found = recording_of(reader, path)
            if found != layer.recording_uuid:
                raise LabelError("labels of something else", expected=layer.recording_uuid, got=found, where=path)
            number = find_layer(reader, layer.camera, layer.annotator, layer.blind)
            if number is None:
                raise _no_labels(layer, path)
            self._number = number
            self._read_all()

    @classmethod
    def open(
        cls,
        folder: Path,
        recording_uuid: str,
        camera: str,
        annotator: str,
        *,
        blind: bool = False,
        tool: str = "",
        session: str = "",
    ) -> Self:
        """Open a layer for writing, starting it if it is new. `tool` is noted in every label made here.

        With a `session` undo and redo concern what was done under that name only; without one, the whole layer.
        Journals of version 1 of this recording are taken over first.

        Raises:
            LabelError: if it cannot be written, is damaged, belongs to something else, or another program writes it in
                a shared folder.
        """
        layer = Layer(recording_uuid, camera, annotator, blind)
        for name, value in (("recording", recording_uuid), ("camera", camera), ("annotator", annotator)):
            if not value.strip():
                raise LabelError(f"labels need a name of the {name}", got=repr(value))
        path = layer.path(folder)
        # First the writer: it makes the file that the reader opens.
        writer = open_to_write(path, recording_uuid)
        try:
            notes = migrate(writer, folder, recording_uuid)
            with sqlite_errors(path, "cannot write labels here"):
                number = find_layer(writer, camera, annotator, blind)
                if number is None:
                    with transaction(writer):
                        number = make_layer(writer, camera, annotator, blind)
            store = cls(layer, path, open_to_read(path, own=True), notes)
        except BaseException:
            writer.close()
            raise
        store._writer, store.writer, store._follows = writer, Writer(number, session, tool), True
        store._finalizers.append(weakref.finalize(store, writer.close))
        return store

    @classmethod
    def read(cls, folder: Path, layer: Layer, *, follow: bool = False) -> Self:
        """A layer as it is now, for reading only: from a read-only disk, or while other programs write it.

        To `follow` is to see what they write by the next call. Of a damaged store, what can be read; `notes` says so.

        Raises:
            LabelError: if there is none, or it cannot be read.
        """
        path, journal = layer.path(folder), layer.journal(folder)
        if not path.is_file() and not journal.is_file():
            raise _no_labels(layer, path)
        notes: tuple[str, ...] = ()
        is_damaged = False
        if journal.is_file():
            reader, notes = read_with_journal(path, layer, journal)
        else:
            try:
                store = cls(layer, path, open_to_read(path))
                store._follows = follow
                return store
            except DamagedStoreError:
                reader, notes = salvage(path)
                is_damaged = True
        store = cls(layer, path, reader, notes)
        store.is_damaged = is_damaged
        return store

    @property
    def version(self) -> int:
        """Grows with every change of the layer, by whomever: compare it to know whether something changed."""
        with self._lock:
            self._refresh()
            return self._seen

    @property
    def can_undo(self) -> bool:
        return self.next_step() is not None

    @property
    def can_redo(self) -> bool:
        return self.next_step(redo=True) is not None

    def next_step(self, *, redo: bool = False) -> int | None:
        """Number of the edit that `step_back` takes back, or brings back, next; None without one."""
        history = self._followed()
        edits = history.undone if redo else history.done
        return edits[-1] if edits else None

    def put(self, label: Label) -> None:
        """Add or replace the label at its time."""
        self.edit(put=(label,))

    def delete(self, t_us: int) -> bool:
        """Make a time unchecked again; False if it was already."""
        return self.edit(delete=(t_us,)) > 0

    def edit(
        self,
        *,
        put: Iterable[Label] = (),
        delete: Iterable[int] = (),
        put_contacts: Iterable[ContactLabel] = (),
        delete_contacts: Iterable[int] = (),
        reject_contacts: Iterable[ContactLabel] = (),
    ) -> int:
        """Several changes as one: one write, one step of undo, all or nothing. Returns how many times it touches.

        A contact at a time is one thing, a label of the same time another. Proposed contacts that are wrong are
        remembered as rejected, until there is a contact at their time.

        Raises:
            LabelError: if it is not saved.
        """
        stamped, gone = tuple(self._stamp(label) for label in put), tuple(delete)
        contacts, ended = tuple(self._stamp(contact) for contact in put_contacts), tuple(delete_contacts)
        wrong = tuple(self._stamp(contact) for contact in reject_contacts)
        for new, old in ((stamped, gone), (contacts, ended), (wrong, {*ended, *(one.t_us for one in contacts)})):
            times = {one.t_us for one in new}
            if len(times) != len(new) or times & set(old):
                raise LabelError("one edit says two things about the same time", where=self.path)
        if not (stamped or gone or contacts or ended or wrong):
            return 0
        with self.writing() as db, transaction(db):
            touched = add_edit(
                db,
                self.writer,
                stamped,
                gone,
                put_contacts=contacts,
                delete_contacts=ended,
                reject_contacts=wrong,
            )
        return len(touched)

    def reject(self, t_us: int, x_px: float, y_px: float, r_px: float | None, detector: str) -> None:
        """Note that a proposal of a detector is wrong, as one step of undo. No label changes.

        Args:
            t_us: time of the proposal.
            x_px: its column.
            y_px: its row.
            r_px: its radius; None: not known.
            detector: what proposed it.

        Raises:
            LabelError: if it is not saved.
        """
        with self.writing() as db, transaction(db):
            add_rejection(db, self.writer, t_us, x_px, y_px, r_px if r_px and r_px > 0 else None, detector)

    def rejected(self) -> frozenset[tuple[int, str]]:
        """(time, detector) of every proposal that was found wrong in this layer."""
        with self._lock, sqlite_errors(self.path, "cannot read the labels"):
            return current_rejected(self._reader, self._number)

    def undo(self) -> tuple[int, ...]:
        """Take back the latest edit, also of an earlier session; returns the times it touched, () if none is left."""
        return self.step_back().touched_us

    def redo(self) -> tuple[int, ...]:
        """Bring back the edit that was undone last; returns the times it touched, () if there is none."""
        return self.step_back(redo=True).touched_us

    def step_back(self, *, redo: bool = False) -> UndoStep:
        """Undo or redo one edit of this session, but for times that somebody else has changed since.

        Raises:
            LabelError: if it is not saved.
        """
        if self.next_step(redo=redo) is None:
            return UndoStep()
        with self.writing() as db, self._history_lock, transaction(db):
            return step_back(db, self.writer, self._history, redo=redo)

    def at(self, t_us: int) -> Label | None:
        """The label at exactly this time; None: unchecked."""
        with self._lock:
            self._refresh()
            return self._label(t_us, self._seen)

    def labels(self) -> LabelArrays:
        """All labels as sorted columns: a snapshot that does not change."""
        with self._lock:
            self._refresh()
            return self._arrays

    def independent(self) -> IndependentLabels:
        """What this annotator said before seeing another's label, as far as the log of edits knows."""
        with self._lock, sqlite_errors(self.path, "cannot read the labels"):
            self._refresh()
            arrays, upto = self._arrays, self._seen
            before = values_before_settling(self._reader, self._number, upto=upto)
            for t_us, values in before:
                arrays = arrays.changed(t_us, None if values is None else label_of(t_us, values))
            copied_us = times_by_others(self._reader, self._number, self.layer.annotator, upto=upto)
        source = arrays.source.copy()
        source[np.isin(arrays.t_us, copied_us)] = SOURCES.index(PositionSource.IMPORTED)
        settled_us = np.array([t_us for t_us, _ in before], np.int64)
        return IndependentLabels(replace(arrays, source=source), settled_us, copied_us)

    def before_settling(self) -> tuple[Label, ...]:
        """What was said before a conflict was settled, or a label left out by a merge, by time; only there."""
        with self._lock, sqlite_errors(self.path, "cannot read the labels"):
            self._refresh()
            before = values_before_settling(self._reader, self._number, upto=self._seen)
        return tuple(label_of(t_us, values) for t_us, values in before if values is not None)

    def deleted(self) -> DeletedTimes:
        """What was taken away."""
        with self._lock, sqlite_errors(self.path, "cannot read the labels"):
            self._refresh()
            return deleted_times(self._reader, self._number)

    def all(self) -> tuple[Label, ...]:
        """All labels with their provenance, by time."""
        with self._lock, sqlite_errors(self.path, "cannot read the labels"):
            self._refresh()
            rows = current_rows(self._reader, self._number, upto=self._seen).fetchall()
        return tuple(label_of(row[0], row[2:]) for row in rows)

    def contacts(self) -> tuple[ContactLabel, ...]:
        """All contacts with their provenance, by time."""
        with self._lock, sqlite_errors(self.path, "cannot read the labels"):
            self._refresh()
            rows = current_contacts(self._reader, self._number, upto=self._seen)
        return tuple(contact_of(t_us, values) for t_us, values in rows)

    def rejected_contacts(self) -> tuple[int, ...]:
        """Times of the proposed contacts that were found wrong in this layer, ascending."""
        with self._lock, sqlite_errors(self.path, "cannot read the labels"):
            self._refresh()
            return tuple(current_rejections(self._reader, self._number, upto=self._seen))

    def by_time(self) -> Mapping[int, Label]:
        """All labels by their time, ascending: a snapshot that does not change."""
        with self._lock:
            self._refresh()
            upto = self._seen
            return LabelsByTime(self._arrays, lambda t_us: self._label(t_us, upto))

    def progress(self, t_us: ArrayLike) -> LabelProgress:
        """How many of these times are labelled, and how."""
        arrays, times = self.labels(), np.unique(np.asarray(t_us, np.int64))
        states = arrays.state[np.isin(arrays.t_us, times)]
        return LabelProgress(len(times), len(states), Counter(tuple(LabelState)[state] for state in states.tolist()))

    def checkpoint(self) -> None:
        """Copy the log into the store's file, which then holds all labels by itself.

        Raises:
            LabelError: if that cannot be written. The labels are safe in the log.
        """
        with self.writing() as db:
            work_in_log(db)

    def close(self) -> None:
        """Let go of the file: everything is saved already."""
        with self._write_lock, self._lock:
            self._writer, self._follows = None, False
            for finalize in self._finalizers:  # the writer last: it works the log into the file
                finalize()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _stamp(self, label: AnyLabel) -> AnyLabel:
        made = label.provenance
        return replace(
            label,
            provenance=replace(
                made,
                annotator=made.annotator or self.layer.annotator,
                made_at_us=made.made_at_us or time.time_ns() // 1000,
                tool=made.tool or self.writer.tool,
            ),
        )

    @contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """The connection that writes, for this thread alone; errors of SQLite become one line.

        Raises:
            LabelError: if the layer is open for reading only.
        """
        with self._write_lock:
            if self._writer is None:
                raise LabelError("these labels are open for reading only", where=self.path)
            with sqlite_errors(self.path, "this label is not saved", _NOT_SAVED):
                yield self._writer

    def _followed(self) -> SessionHistory:
        with self._history_lock, self._lock, sqlite_errors(self.path, "cannot read the labels"):
            if self._writer is not None:
                self._history.follow(self._reader, self.writer)
            return self._history

    def _label(self, t_us: int, upto: int) -> Label | None:
        try:
            with self._lock, sqlite_errors(self.path, "cannot read the labels"):
                values = value_at(self._reader, self._number, t_us, upto=upto)
        except sqlite3.ProgrammingError as error:
            raise LabelError("these labels are closed", where=self.path) from error
        return None if values is None else label_of(t_us, values)

    def _refresh(self) -> None:
        """Take up what was written since, here or elsewhere."""
        if not self._follows:
            return
        with sqlite_errors(self.path, "cannot read the labels"):
            if isinstance(self._reader, Snapshot) and self._reader.refresh():
                self._change_mark = -1
            mark = self._reader.execute("PRAGMA data_version").fetchone()[0]
            if mark == self._change_mark:
                return
            with self._moment():
                newest = newest_edit(self._reader, self._number, after=self._seen)
                rows = changes_since(self._reader, self._number, self._seen, most=_FEW_CHANGES + 1)
            if len(rows) > _FEW_CHANGES:
                self._read_all()
                return
            for t_us, values in rows:
                self._arrays = self._arrays.changed(t_us, None if values[0] is None else label_of(t_us, values))
            self._change_mark, self._seen = mark, newest

    def _read_all(self) -> None:
        mark = self._reader.execute("PRAGMA data_version").fetchone()[0]
        with self._moment():
            self._seen = newest_edit(self._reader, self._number)
            self._arrays = current_arrays(self._reader, self._number, upto=self._seen)
        self._change_mark = mark

    @contextmanager
    def _moment(self) -> Iterator[None]:
        """Inside, others' writes are not seen: what is read belongs together."""
        self._reader.execute("BEGIN")
        try:
            yield
        finally:
            self._reader.execute("COMMIT")


def _no_labels(layer: Layer, path: Path) -> LabelError:
    what = "no second looks" if layer.blind else "no labels"
    return LabelError(what, got=f"nothing by {layer.annotator!r} for {layer.camera!r}", where=path)
