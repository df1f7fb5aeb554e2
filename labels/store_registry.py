"""All layers that a program has open, one for each session that looks at it or writes it."""

from __future__ import annotations

import threading
from collections import Counter
from pathlib import Path

from labels.database.connection import work_in_logs
from labels.store import LabelStore, Layer, find_layers, has_labels

Key = tuple[Layer, str]
"""A layer, and the session that has it open."""


class LabelStoreRegistry:
    """Opens each layer at most once for each session that asks. Safe to use from several threads."""

    def __init__(self, folder: Path, *, tool: str = "") -> None:
        self._folder = folder
        work_in_logs(folder)
        self._tool = tool
        self._lock = threading.Lock()
        self._written: dict[Key, LabelStore] = {}
        self._looked_at: dict[Key, LabelStore] = {}
        self._users: Counter[str] = Counter()

    @property
    def folder(self) -> Path:
        """Where the layers are."""
        return self._folder

    def acquire(self, session: str = "") -> None:
        """One more user of a session's stores; each of them calls `release` once."""
        with self._lock:
            self._users[session] += 1

    def release(self, session: str = "") -> None:
        """A user is gone. The last one of a session closes its stores."""
        with self._lock:
            self._users[session] -= 1
            if not self._users[session]:
                del self._users[session]
                self._close_stores({session})

    def store(
        self, recording_uuid: str, camera: str, annotator: str, *, blind: bool = False, session: str = ""
    ) -> LabelStore:
        """The store of a layer, opened for writing on first use; what a session undoes is its own.

        One that it has looked at stays open beside it: labels are read from that one by time, until these are taken up.

        Raises:
            LabelError: if it cannot be opened.
        """
        key = Layer(recording_uuid, camera, annotator, blind), session
        with self._lock:
            if key not in self._written:
                self._written[key] = LabelStore.open(
                    self._folder, recording_uuid, camera, annotator, blind=blind, tool=self._tool, session=session
                )
            return self._written[key]

    def layers(self, recording_uuid: str) -> tuple[Layer, ...]:
        """Whose labels of a recording exist, open or not."""
        return find_layers(self._folder, recording_uuid)

    def look(self, layer: Layer, session: str = "") -> LabelStore | None:
        """A layer to look at, which follows what others write into it; None if nobody has begun it. Leaves no trace.

        Raises:
            LabelError: if it cannot be read.
        """
        key = layer, session
        with self._lock:
            found = self._written.get(key) or self._looked_at.get(key)
            if found is None and has_labels(self._folder, layer):
                found = self._looked_at[key] = LabelStore.read(self._folder, layer, follow=True)
            return found

    def close(self) -> None:
        """Close every store."""
        with self._lock:
            self._close_stores({session for _, session in (*self._written, *self._looked_at)})

    def _close_stores(self, sessions: set[str]) -> None:
        for stores in (self._looked_at, self._written):
            for key in [key for key in stores if key[1] in sessions]:
                stores.pop(key).close()
