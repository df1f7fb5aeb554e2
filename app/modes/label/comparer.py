"""Compares one's own labels with another's, off the loop: which others there are, and what is read of them."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Final

from app.background.jobs import LatestWins
from app.modes.label.comparison import LabelComparison, LabelsOf, compare_labels
from app.modes.label.editor import LabelEditor
from app.modes.label.labelling import Labelling
from core.errors import LabelError, RallyscopeError
from labels.arrays import LabelArrays, label_arrays
from labels.contacts import join_contacts
from labels.database.folder import FILE
from labels.store import LabelStore, Layer, find_layers, has_labels
from labels.store_contents import StoreContents, layers_of_store, read_store

FOLDER: Final = "labels-of-others"
"""In the workspace: a colleague's store, or all of a colleague's folder of labels."""
SUFFIX: Final = ".sqlite"
DEEPEST: Final = 3
"""Folders: `labels-of-others/bea/<recording>/labels.sqlite`."""
MAX_ENTRIES: Final = 2_000
"""Most entries of one folder, and all that is in it, that are looked at."""
MAX_STORES: Final = 100


@dataclass(frozen=True, slots=True)
class OtherLabels:
    """Somebody's labels of this recording."""

    title: str
    """As the list has it."""
    annotator: str
    path: Path | None = None
    """Place of the store; None: the one that is labelled in."""


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


LIST_EVERY_S: Final = 5.0
SOON_S: Final = 0.05
LOOK_EVERY_S: Final = 0.4
"""How soon what the other writes is seen here."""
Versions = tuple[LabelArrays, object]
"""One's own labels, and a mark that changes with the other's."""


@dataclass(frozen=True, slots=True, eq=False)
class CompareAsk:
    """Whose labels are to be held beside whose."""

    other: Offered
    layer: Layer
    """One's own."""
    mine: LabelsOf
    cameras: tuple[str, ...]
    """Those whose layers may hold contacts."""
    duration_us: int
    known: Versions | None
    """What was compared last: if both are still the same, there is no other answer."""


Answer = tuple[LabelComparison, Versions, tuple[str, ...]] | RallyscopeError | None
"""What was found, in what, and what could not be read of it; or why nothing was. None: all is as it was."""


class LabelComparer:
    """Compares the labels of two annotators in one browser. Called by its loop."""

    def __init__(self, editor: LabelEditor, labels: Path, stores: OtherStores, pool: Executor) -> None:
        """`labels`: the folder of the workspace's labels."""
        self._editor, self._labels, self._stores = editor, labels, stores
        self.offered: dict[str, Offered] = {}
        """By title."""
        self.chosen: Offered | None = None
        self.wanted = ""
        """Title of what is chosen, or will be once it is offered; "": nothing."""
        self.problem = ""
        """Why there is no comparison, in one line."""
        self.notes: tuple[str, ...] = ()
        self._known: Versions | None = None
        self._given: LabelComparison | None = None
        """What was found last."""
        self._file: tuple[object, StoreContents] | None = None
        self._of_file: tuple[object, LabelsOf] | None = None
        """What was read last of a file, and the layer of it that was compared last."""
        self._stores_read: dict[Layer, LabelStore] = {}
        """The other's layers in one's own store. They are closed when nobody holds any of their labels any more."""
        self._compared_s = self._listed_s = float("-inf")
        later = editor.callbacks.later
        self._listing = LatestWins(pool, self._list, lambda _, found: later(lambda: self._offer(found)), lambda _: None)
        self._work = LatestWins(
            pool,
            self._compare,
            lambda ask, answer: later(lambda: self._take(ask, answer)),
            lambda error: later(lambda: self._fail(error)),
        )

    def choose(self, title: str) -> None:
        """Compare with this one of the list from now on; with nobody for any other title."""
        self.chosen = self.offered.get(title)
        self.wanted = "" if self.chosen is None else title
        self._forget()

    def choose_when_offered(self, title: str) -> None:
        """The same with a title that need not be in the list yet."""
        self.choose(title)
        self.wanted = title

    def tick(self, wall_s: float) -> None:
        """Look, now and then, who else there is, and what changed on either side."""
        now = self._editor.labelling
        view = now.view
        if wall_s - self._listed_s >= LIST_EVERY_S:
            self._listed_s = wall_s
            self._listing.submit((view.annotator, now.recording.uuid))
        other = self.chosen
        if isinstance(other, OtherLabels) and other.path is None and other.annotator == view.annotator:
            self.choose("")  # the person goes on under that name
            now = self._editor.labelling
        if now.compared is not self._given:  # a conflict is being resolved, or another layer is labelled
            self._given, self._known = now.compared, None
        due_s = self._compared_s + (SOON_S if self._known is None else LOOK_EVERY_S)
        ready = view.camera in now.saved and not view.repeat and not self._editor.writer.waiting
        if self.chosen is None or self.problem or not ready or wall_s < due_s or self._work.busy:
            return
        self._compared_s = wall_s
        self._work.submit(_ask(now, self.chosen, self._known))

    def close(self) -> None:
        """The browser or the recording is gone."""
        self._listing.close()
        self._work.close()

    def _forget(self) -> None:
        self._known, self._given, self.problem, self.notes = None, None, "", ()
        self._editor.compare_with(None)

    # Off the loop -------------------------------------------------------------------------------------------------

    def _list(self, who: tuple[str, str]) -> dict[str, Offered]:
        annotator, uuid = who
        return others_to_compare(annotator, find_layers(self._labels, uuid), self._stores.of(uuid))

    def _compare(self, ask: CompareAsk) -> Answer:
        other, camera = ask.other, ask.layer.camera
        if isinstance(other, RefusedStore):
            return refusal(other, ask.layer.recording_uuid)
        try:
            theirs, mark, notes = self._their_labels(other, ask)
        except LabelError as error:
            return error if other.path is None else _named(error, other.path)
        versions = ask.mine.arrays, mark
        if ask.known is not None and ask.known[0] is versions[0] and ask.known[1] == versions[1]:
            return None
        return compare_labels(camera, other.title, ask.mine, theirs, ask.duration_us), versions, notes

    def _their_labels(self, other: OtherLabels, ask: CompareAsk) -> tuple[LabelsOf, object, tuple[str, ...]]:
        if other.path is not None:
            return self._labels_in_file(other, other.path, ask.layer)
        wanted = replace(ask.layer, annotator=other.annotator)
        layers = [replace(wanted, camera=camera) for camera in ask.cameras]
        known = self._stores_read
        self._stores_read = {
            layer: known.get(layer) or LabelStore.read(self._labels, layer, follow=True)
            for layer in layers
            if layer in known or has_labels(self._labels, layer)
        }
        stores = self._stores_read
        # First: what is written meanwhile is seen by the next look.
        versions = tuple((layer, store.version) for layer, store in stores.items())
        contacts = reduce(join_contacts, (store.contacts() for store in stores.values()), ())
        if wanted not in stores:
            return LabelsOf(other.annotator, {}, label_arrays(()), contacts), versions, ()
        store = stores[wanted]
        return LabelsOf(other.annotator, store.by_time(), store.labels(), contacts), versions, store.notes

    def _labels_in_file(self, other: OtherLabels, path: Path, layer: Layer) -> tuple[LabelsOf, object, tuple[str, ...]]:
        """Read anew when the file or its log has changed."""
        mark = (path, *_change_mark(path), *_change_mark(path.with_name(f"{path.name}-wal")))
        if self._file is None or self._file[0] != mark:
            contents = read_store(path)
            if contents.recording_uuid != layer.recording_uuid:
                raise _of_another(path, layer.recording_uuid, contents.recording_uuid)
            self._file = mark, contents
        contents, wanted = self._file[1], replace(layer, annotator=other.annotator)
        if self._of_file is None or self._of_file[0] != (mark, wanted):
            labels = contents.layers.get(wanted, {})
            own = [those for of, those in contents.contacts.items() if replace(of, camera=wanted.camera) == wanted]
            contacts = reduce(join_contacts, own, ())
            self._of_file = (mark, wanted), LabelsOf(other.annotator, labels, label_arrays(labels.values()), contacts)
        notes = tuple(note.replace(str(path), path.name) for note in contents.notes)
        return self._of_file[1], (mark, wanted), notes

    # In the loop --------------------------------------------------------------------------------------------------

    def _offer(self, found: dict[str, Offered]) -> None:
        self.offered = found
        if self.chosen is None and self.wanted in found:
            self.choose(self.wanted)

    def _take(self, ask: CompareAsk, answer: Answer) -> None:
        now = self._editor.labelling
        if isinstance(answer, RallyscopeError):
            if ask.other is self.chosen:
                self._forget()
                self.problem = str(answer)
            return
        stale = ask.other is not self.chosen or ask.mine.arrays is not now.here.arrays or self._editor.writer.waiting
        if answer is None or stale or ask.layer != replace(now.layer, blind=False):
            return  # what changed meanwhile is compared next
        self._given, self._known, self.notes = answer
        self._editor.compare_with(self._given)

    def _fail(self, error: Exception) -> None:
        """A mistake of ours: it is not tried again and again."""
        self._forget()
        self.problem = "this cannot be compared"
        self._editor.callbacks.report(error)


def refusal(store: RefusedStore, recording_uuid: str) -> LabelError:
    """Why a store cannot be compared with, in one line that names the file and no folder."""
    try:
        layers = layers_of_store(store.path)
    except LabelError as error:
        return _named(error, store.path)
    found = next((layer.recording_uuid for layer in layers), "one that nobody has labelled")
    return _of_another(store.path, recording_uuid, found)


def _ask(now: Labelling, other: Offered, known: Versions | None) -> CompareAsk:
    mine = LabelsOf(now.view.annotator, now.here.labels, now.here.arrays)
    layer = replace(now.layer, blind=False)
    return CompareAsk(other, layer, mine, tuple(now.sources), now.recording.duration_us, known)


def _of_another(path: Path, expected: str, got: str) -> LabelError:
    return LabelError("labels of another recording", expected=expected, got=got, where=path.name)


def _named(error: LabelError, path: Path) -> LabelError:
    return LabelError(str(error).replace(str(path), path.name))


def _change_mark(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except OSError:
        return (0, 0)
    return status.st_size, status.st_mtime_ns
