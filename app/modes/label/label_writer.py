"""Where labels are written: one change after the other, off the loop, each acknowledged only when it is on the disk."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

from core.errors import LabelError
from labels.arrays import LabelArrays, label_arrays
from labels.model import ContactLabel, Label
from labels.store import LabelStore, Layer
from labels.store_registry import LabelStoreRegistry

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Saved:
    """A layer as it is on the disk, and what a change has done to it."""

    layer: Layer
    labels: Mapping[int, Label]
    """All labels of the layer, by time; a snapshot."""
    arrays: LabelArrays
    touched_us: tuple[int, ...]
    can_undo: bool
    can_redo: bool
    notes: tuple[str, ...]
    version: int
    rejected: frozenset[tuple[int, str]] = frozenset()
    """(time, detector) of the proposals that were found wrong."""
    contacts: tuple[ContactLabel, ...] = ()
    """Bounces, hits and net touches, by time."""
    no_contacts_us: tuple[int, ...] = ()
    """Times at which one was proposed and found wrong, ascending."""


Change = Callable[[LabelStore], tuple[int, ...]]
"""Changes a store and returns the times it touched. It may take as long as it needs."""
Done = Callable[[Saved], None]
Failed = Callable[[Exception], None]
IDLE_S: Final = 2.0
"""Rest after the latest change until the store's log is copied into its file."""


class LabelWriter:
    """The layers of one recording in one browser. Methods are called by the loop; answers come from another thread."""

    def __init__(self, registry: LabelStoreRegistry, session: str) -> None:
        self._registry = registry
        self._session = session
        """Under which this browser's edits are kept: undo takes back those."""
        registry.acquire(session)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="rallyscope-labels")
        self._waiting = 0
        self._looking = 0
        self._lock = threading.Lock()
        self._logged: tuple[LabelStore, float] | None = None
        """The store of the latest change, and when that was, until the log is copied into the file."""
        self.saved_at: float | None = None
        """Wall-clock time of the latest acknowledged change."""
        self.failure: str | None = None
        """Why the latest change is not saved."""

    @property
    def waiting(self) -> int:
        """Changes that are not acknowledged yet."""
        return self._waiting

    def write(self, layer: Layer, change: Change, done: Done, failed: Failed) -> None:
        """Carry out a change after all that were asked for before."""
        with self._lock:
            self._waiting += 1
        self._worker.submit(self._carry_out, layer, change, done, failed)

    def look(self, layer: Layer, done: Done, failed: Failed) -> None:
        """Read a layer; nothing is written, so that a look leaves no trace and needs no writable disk."""
        self._worker.submit(self._look, layer, done, failed)

    def look_again(self, versions: Mapping[Layer, int], done: Done, failed: Failed) -> None:
        """Read those layers that are no longer what they were; nothing if the last such look is not over."""
        with self._lock:
            if self._looking or self._waiting:
                return
            self._looking += 1
        self._worker.submit(self._look_again, dict(versions), done, failed)

    def checkpoint_when_idle(self, wall_s: float) -> None:
        """Copy the log into the store's file once nothing was written for a while: call it now and then."""
        logged = self._logged
        if logged is not None and not self._waiting and wall_s - logged[1] > IDLE_S:
            self._logged = None
            self._worker.submit(self._checkpoint, logged[0])

    def store(self, layer: Layer) -> LabelStore:
        """The store of a layer, for changes that need another one than their own; call it inside a change.

        Raises:
            LabelError: if it cannot be opened.
        """
        uuid, blind = layer.recording_uuid, layer.blind
        return self._registry.store(uuid, layer.camera, layer.annotator, blind=blind, session=self._session)

    def close(self) -> None:
        """Let go of the files once everything that was asked for is saved."""
        self._worker.submit(self._registry.release, self._session)
        self._worker.shutdown(wait=False)

    def _carry_out(self, layer: Layer, change: Change, done: Done, failed: Failed) -> None:
        try:
            store = self.store(layer)
            before = store.version
            touched = change(store)
            if store.version != before:
                self.saved_at = time.time()
                self._logged = store, time.monotonic()
            self.failure = None
            answer = _answer(layer, store, touched)
        except Exception as error:  # noqa: BLE001 (the browser hears of any)
            self.failure = str(error)
            failed(error)
        else:
            done(answer)
        finally:
            self._finish()  # last: who sees that nothing waits has the answer before him

    def _checkpoint(self, store: LabelStore) -> None:
        try:
            store.checkpoint()
        except LabelError as error:  # the labels are safe: the next one tries again
            logger.warning("the log of the labels is not copied into their file: %s", error)

    def _look(self, layer: Layer, done: Done, failed: Failed) -> None:
        try:
            store = self._registry.look(layer, self._session)
            done(no_labels(layer) if store is None else _answer(layer, store, ()))
        except Exception as error:  # noqa: BLE001 (the browser hears of any)
            failed(error)

    def _look_again(self, versions: dict[Layer, int], done: Done, failed: Failed) -> None:
        try:
            for layer, version in versions.items():
                store = self._registry.look(layer, self._session)
                if store is not None and store.version != version:
                    done(_answer(layer, store, ()))
        except Exception as error:  # noqa: BLE001 (the browser hears of any)
            failed(error)
        finally:
            with self._lock:
                self._looking -= 1

    def _finish(self) -> None:
        with self._lock:
            self._waiting -= 1


def no_labels(layer: Layer) -> Saved:
    """A layer that nobody has begun."""
    return Saved(layer, {}, label_arrays(()), (), False, False, (), 0)


def _answer(layer: Layer, store: LabelStore, touched: tuple[int, ...]) -> Saved:
    version = store.version  # first: what is written meanwhile by others is seen by the next look
    undo, redo = store.can_undo, store.can_redo
    labels, arrays, rejected, contacts = store.by_time(), store.labels(), store.rejected(), store.contacts()
    no_contacts_us = store.rejected_contacts()
    return Saved(layer, labels, arrays, touched, undo, redo, store.notes, version, rejected, contacts, no_contacts_us)
