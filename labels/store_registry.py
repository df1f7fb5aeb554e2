"""All layers that a program has open: several browsers of one annotator share one store, each file has one writer."""

from __future__ import annotations

import threading
from pathlib import Path

from labels.store import LabelStore, Layer, find_layers


class LabelStoreRegistry:
    """Opens each layer at most once and hands out the same store to everybody. Safe to use from several threads."""

    def __init__(self, folder: Path, *, tool: str = "") -> None:
        self._folder = folder
        self._tool = tool
        self._lock = threading.Lock()
        self._stores: dict[Layer, LabelStore] = {}
        self._users = 0

    @property
    def folder(self) -> Path:
        """Where the layers are."""
        return self._folder

    def acquire(self) -> None:
        """One more user; each of them calls `release` once."""
        with self._lock:
            self._users += 1

    def release(self) -> None:
        """A user is gone. The last one closes every store, so that other programs may write those layers."""
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._close_stores()

    def store(self, recording_uuid: str, camera: str, annotator: str, *, blind: bool = False) -> LabelStore:
        """The store of a layer, opened for writing on first use.

        Raises:
            LabelError: if it cannot be opened.
        """
        layer = Layer(recording_uuid, camera, annotator, blind)
        with self._lock:
            if layer not in self._stores:
                self._stores[layer] = LabelStore.open(
                    self._folder, recording_uuid, camera, annotator, blind=blind, tool=self._tool
                )
            return self._stores[layer]

    def layers(self, recording_uuid: str) -> tuple[Layer, ...]:
        """Whose labels of a recording exist, open or not."""
        return find_layers(self._folder, recording_uuid)

    def read(self, layer: Layer) -> LabelStore:
        """A layer to look at beside one's own: the open store if there is one, else a snapshot of the file."""
        with self._lock:
            open_store = self._stores.get(layer)
        return open_store if open_store is not None else LabelStore.read(self._folder, layer)

    def close(self) -> None:
        """Close every store."""
        with self._lock:
            self._close_stores()

    def _close_stores(self) -> None:
        for store in self._stores.values():
            store.close()
        self._stores.clear()
