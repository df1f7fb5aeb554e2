"""Whose labels one's own can be compared with: other annotators of the same store, and other stores that lie ready.

Stores of others are looked for in a folder of the workspace and in those that the command line named. A browser is
told names and sends one back; a path never comes from a browser.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import LabelError
from labels.database.folder import FILE, Layer
from labels.store_contents import layers_of_store

FOLDER: Final = "labels-of-others"
"""In the workspace: a colleague's store, or all of a colleague's folder of labels."""
SUFFIX: Final = ".sqlite"
DEEPEST: Final = 3
"""Folders: `labels-of-others/bea/<recording>/labels.sqlite`."""
MAX_ENTRIES: Final = 2_000
"""Of one folder and all that is in it."""
MAX_STORES: Final = 100


@dataclass(frozen=True, slots=True)
class OtherLabels:
    """Somebody's labels of this recording."""

    title: str
    """As the list has it."""
    annotator: str
    path: Path | None = None
    """Of the store; None: the one that is labelled in."""


@dataclass(frozen=True, slots=True)
class RefusedStore:
    """A file that is called a store and is none of this recording: choosing it says why."""

    title: str
    path: Path


Offered = OtherLabels | RefusedStore


class OtherStores:
    """The stores in some folders. Each is looked into once, until it changes. Thread-safe."""

    def __init__(self, workspace: Path, folders: tuple[Path, ...] = ()) -> None:
        self._places = (workspace / FOLDER, *folders)
        self._known: dict[tuple[Path, int, int], tuple[Layer, ...] | None] = {}
        self._lock = threading.Lock()

    def of(self, recording_uuid: str) -> tuple[Offered, ...]:
        """Whose labels of a recording there are, by store. A file put there by hand is listed even if it is no use."""
        found: list[Offered] = []
        for place, path in self._files():
            layers = self._layers(path)
            by_hand = place is self._places[0] and path.parent == place
            where = path.relative_to(place.parent).as_posix()
            if layers is None:
                if by_hand or path.name == FILE:
                    found.append(RefusedStore(f"{where} (cannot be read)", path))
                continue
            names = {layer.annotator for layer in layers if layer.recording_uuid == recording_uuid}
            found += [OtherLabels(f"{name} in {where}", name, path) for name in sorted(names)]
            if not names and by_hand:
                found.append(RefusedStore(f"{where} (of another recording)", path))
        return tuple(found)

    def _files(self) -> list[tuple[Path, Path]]:
        return [(place, path) for place in self._places for path in sorted(_stores_below(place))[:MAX_STORES]]

    def _layers(self, path: Path) -> tuple[Layer, ...] | None:
        try:
            status = path.stat()
        except OSError:
            return ()  # it was taken away
        key = path, status.st_size, status.st_mtime_ns
        with self._lock:
            if key in self._known:
                return self._known[key]
        try:
            layers = tuple(layer for layer in layers_of_store(path) if not layer.blind)
        except LabelError:
            layers = None
        with self._lock:
            self._known[key] = layers
        return layers


def others_to_compare(annotator: str, layers: Iterable[Layer], stores: Iterable[Offered]) -> dict[str, Offered]:
    """What the list offers to an annotator, by title: the others of one's own store first."""
    names = sorted({layer.annotator for layer in layers if not layer.blind} - {annotator})
    return {offer.title: offer for offer in (*(OtherLabels(name, name) for name in names), *stores)}


def _stores_below(place: Path) -> Iterator[Path]:
    """Files with the suffix of a store, no deeper than is said; nothing hidden."""
    left = MAX_ENTRIES
    waiting = [(place, 1)]
    while waiting:
        folder, depth = waiting.pop(0)
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    left -= 1
                    if left < 0:
                        return
                    if entry.name.startswith("."):
                        continue
                    if entry.is_dir(follow_symlinks=False):
                        if depth < DEEPEST:
                            waiting.append((Path(entry.path), depth + 1))
                    elif entry.name.endswith(SUFFIX) and entry.is_file():
                        yield Path(entry.path)
        except OSError:  # there is none, or it may not be read
            continue
