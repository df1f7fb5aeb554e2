"""Label stores put together into a new one: what annotators disagree about is listed and left out, the rest is merged.

A store holds a layer for each annotator and camera, and so does the merged one. Two annotators are in conflict about a
time of a camera if they say different states, or centres farther apart than they may be. Of what one annotator said of
a time in two stores, the later counts.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from core.errors import LabelError
from core.files import replacing
from labels.conflicts import WITHIN_PX, LabelConflict, find_conflicts
from labels.database.connection import open_to_write, sqlite_errors, transaction
from labels.database.edit_log import Writer, add_edit, make_layer
from labels.database.folder import Layer
from labels.database.rows import MERGE_TOOL
from labels.model import Label
from labels.store_contents import read_store


@dataclass(frozen=True, slots=True)
class MergedStores:
    """What a merge did."""

    recording_uuid: str
    labels: int
    """In the new store, blind repeats among them."""
    conflicts: tuple[LabelConflict, ...]
    """Those that nobody has settled."""
    settled: int
    """Conflicts that one of the two has settled: that one's label is in the new store, the other's is not."""
    left_out: int
    """Labels that are or were in conflict, and so not in the new store."""
    superseded: int
    """Labels for which the same annotator said something later in another store."""
    notes: tuple[str, ...]


@dataclass(slots=True)
class _Accumulator:
    """Labels of all stores by layer and time."""

    labels: dict[Layer, dict[int, Label]] = field(default_factory=lambda: defaultdict(dict))
    first: dict[Layer, dict[int, Label]] = field(default_factory=lambda: defaultdict(dict))
    """What was said before a conflict was settled."""
    superseded: int = 0
    notes: list[str] = field(default_factory=list)

    def add(self, layer: Layer, labels: Iterable[Label]) -> None:
        known = self.labels[layer]
        for label in labels:
            before = known.get(label.t_us)
            self.superseded += before is not None and before != label
            if before is None or before.provenance.made_at_us < label.provenance.made_at_us:
                known[label.t_us] = label

    def add_first(self, layer: Layer, labels: Iterable[Label]) -> None:
        known = self.first[layer]
        for label in labels:
            before = known.get(label.t_us)
            if before is None or label.provenance.made_at_us < before.provenance.made_at_us:
                known[label.t_us] = label


def merge_stores(
    sources: Sequence[Path], out: Path, *, within_px: float = WITHIN_PX, prefer: str | None = None
) -> MergedStores:
    """Put stores of one recording together; a source is a store file, or the folder of a recording's labels.

    In conflicts with `prefer`, that annotator's label is taken and the others' are left out. Of one source alone
    everything is kept: it is copied, and saved if it is damaged.

    Args:
        sources: stores, or folders of them.
        out: the new store.
        within_px: distance up to which two labels agree.
        prefer: annotator whose label counts in a conflict.

    Raises:
        LabelError: if a source cannot be read, they are of different recordings, or `out` is there already.
    """
    if out.exists():
        raise LabelError("there is a file already", where=out, remedy="name another one with --out")
    pile, uuids = _Accumulator(), {}
    for source in sources:
        uuids[source] = _add_source(source, pile)
    if len(set(uuids.values())) != 1:
        stores = ", ".join(f"{path} of {uuid}" for path, uuid in uuids.items())
        raise LabelError("these labels are of different recordings", got=stores)
    uuid = uuids[sources[0]]
    differing = find_conflicts(pile.labels, within_px) if len(sources) > 1 else ()
    dropped = {
        (conflict.camera, conflict.t_us, name)
        for conflict in differing
        for name in conflict.annotators
        if name != (conflict.settled_by or prefer)
    }
    conflicts = tuple(conflict for conflict in differing if conflict.settled_by is None)
    kept = {
        layer: [label for label in labels.values() if layer.blind or not _is_left_out(dropped, layer, label)]
        for layer, labels in pile.labels.items()
    }
    for layer, labels in pile.labels.items():  # what is left out is kept in the log of edits, for `labels agree`
        if not layer.blind:
            pile.add_first(layer, (label for label in labels.values() if _is_left_out(dropped, layer, label)))
    _write(out, uuid, kept, pile.first)
    written = sum(map(len, kept.values()))
    left_out = sum(map(len, pile.labels.values())) - written
    return MergedStores(
        uuid, written, conflicts, len(differing) - len(conflicts), left_out, pile.superseded, tuple(pile.notes)
    )


def _add_source(source: Path, pile: _Accumulator) -> str:
    """Add the labels of a store to the pile; the recording that they are of."""
    found = read_store(source)
    for layer, labels in found.layers.items():
        pile.add(layer, labels.values())
        pile.add_first(layer, found.first[layer].values())
    pile.notes += found.notes
    return found.recording_uuid


def _is_left_out(dropped: set[tuple[str, int, str]], layer: Layer, label: Label) -> bool:
    return (layer.camera, label.t_us, layer.annotator) in dropped


def _write(out: Path, uuid: str, layers: dict[Layer, list[Label]], first: Mapping[Layer, Mapping[int, Label]]) -> None:
    try:
        with replacing(out, durable=True) as partial:
            _fill(partial, out, uuid, layers, first)
    except OSError as error:
        raise LabelError("cannot write the merged labels", got=error.strerror, where=out) from error


def _fill(
    partial: Path,
    out: Path,
    uuid: str,
    layers: dict[Layer, list[Label]],
    first: Mapping[Layer, Mapping[int, Label]],
) -> None:
    """Write what was said first as an edit of its own, before what is said now: the log keeps both."""
    with (
        closing(open_to_write(partial, uuid)) as db,
        sqlite_errors(out, "cannot write the merged labels"),
        transaction(db),
    ):
        for layer, labels in layers.items():
            writer = Writer(make_layer(db, layer.camera, layer.annotator, layer.blind), "", MERGE_TOOL)
            now = {label.t_us: label for label in labels}
            before = {t_us: label for t_us, label in first[layer].items() if label != now.get(t_us)}
            if before:
                add_edit(db, writer, before.values(), ())
            add_edit(db, writer, labels, before.keys() - now.keys())
