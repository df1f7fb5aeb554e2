"""Label stores put together into a new one: what annotators disagree about is listed and left out, the rest is merged.

A store holds a layer for each annotator and camera, and so does the merged one. Two annotators are in conflict about a
time of a camera if they say different states, or centres farther apart than they may be; about a contact, if its kinds
or times differ. Of what one annotator said of a time, or of a contact, in two stores, the later counts, and so does
that it was deleted.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from core.errors import LabelError
from core.files import replacing
from labels.conflicts import WITHIN_PX, LabelConflict, find_conflicts
from labels.contacts import ContactConflict, find_contact_conflicts, match_contacts
from labels.database.connection import open_to_write, sqlite_errors, transaction
from labels.database.contact_rows import DeletedTimes
from labels.database.edit_log import Writer, add_edit, make_layer
from labels.database.folder import Layer
from labels.database.rows import MERGE_TOOL
from labels.model import ContactLabel, Label
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
    """Labels that the same annotator changed or deleted later in another store."""
    notes: tuple[str, ...]
    contacts: int = 0
    """In the new store."""
    contact_conflicts: tuple[ContactConflict, ...] = ()
    """Contacts of which two annotators say different things: only those of `prefer` are in the new store."""


@dataclass(slots=True)
class _Accumulator:
    """Labels of all stores by layer and time."""

    labels: dict[Layer, dict[int, Label]] = field(default_factory=lambda: defaultdict(dict))
    first: dict[Layer, dict[int, Label]] = field(default_factory=lambda: defaultdict(dict))
    """What was said before a conflict was settled."""
    contacts: dict[Layer, tuple[ContactLabel, ...]] = field(default_factory=dict)
    deleted: dict[Layer, DeletedTimes] = field(default_factory=lambda: defaultdict(lambda: DeletedTimes({}, {})))
    """With the latest time at which each was."""
    superseded: int = 0
    notes: list[str] = field(default_factory=list)

    def add(self, layer: Layer, labels: Iterable[Label]) -> None:
        known = self.labels[layer]
        for label in labels:
            before = known.get(label.t_us)
            self.superseded += before is not None and before != label
            if before is None or before.provenance.made_at_us < label.provenance.made_at_us:
                known[label.t_us] = label

    def add_contacts(self, layer: Layer, contacts: Sequence[ContactLabel]) -> None:
        known = self.contacts.get(layer, ())
        old, new = set(range(len(known))), set(range(len(contacts)))
        for mine, theirs in match_contacts(known, contacts):
            before, after = known[mine], contacts[theirs]
            self.superseded += before != after
            if before.provenance.made_at_us < after.provenance.made_at_us:
                old.discard(mine)
            else:
                new.discard(theirs)
        kept = [*(known[row] for row in old), *(contacts[row] for row in new)]
        self.contacts[layer] = tuple(sorted(kept, key=lambda contact: contact.t_us))

    def add_deleted(self, layer: Layer, deleted: DeletedTimes) -> None:
        for known, found in zip(self.deleted[layer], deleted, strict=True):
            known.update({t_us: max(at_us, known.get(t_us, at_us)) for t_us, at_us in found.items()})

    def take_deleted_out(self) -> None:
        """What was said in one store and deleted later in another is no longer said."""
        for layer, (labels_us, contacts_us) in self.deleted.items():
            gone = [one for one in self.labels[layer].values() if _is_older(one, labels_us)]
            for label in gone:
                del self.labels[layer][label.t_us]
            contacts = self.contacts.get(layer, ())
            self.contacts[layer] = tuple(one for one in contacts if not _is_older(one, contacts_us))
            self.superseded += len(gone) + len(contacts) - len(self.contacts[layer])

    def add_first(self, layer: Layer, labels: Iterable[Label]) -> None:
        known = self.first[layer]
        for label in labels:
            before = known.get(label.t_us)
            if before is None or label.provenance.made_at_us < before.provenance.made_at_us:
                known[label.t_us] = label


def _is_older(one: Label | ContactLabel, deleted_us: Mapping[int, int]) -> bool:
    at_us = deleted_us.get(one.t_us)
    return at_us is not None and one.provenance.made_at_us < at_us


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
        LabelError: if a source cannot be read, they are of different recordings, none has labels of `prefer`, or `out`
            is there already.
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
    names = sorted({layer.annotator for layer in pile.labels})
    if prefer is not None and prefer not in names:
        raise LabelError(f"no labels by {prefer!r}", expected=f"one of {', '.join(names)}", where="--prefer")
    pile.take_deleted_out()
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
    contact_conflicts = _contact_conflicts(pile.contacts) if len(sources) > 1 else ()
    contacts = {layer: _without_conflicts(layer, pile.contacts[layer], contact_conflicts, prefer) for layer in kept}
    _write(out, uuid, kept, pile.first, contacts)
    written = sum(map(len, kept.values()))
    left_out = sum(map(len, pile.labels.values())) - written
    return MergedStores(
        uuid, written, conflicts, len(differing) - len(conflicts), left_out, pile.superseded, tuple(pile.notes),
        sum(map(len, contacts.values())), contact_conflicts,
    )  # fmt: skip


def _contact_conflicts(contacts: Mapping[Layer, Sequence[ContactLabel]]) -> tuple[ContactConflict, ...]:
    """What different annotators say differently of one contact. Blind repeats are nobody's word."""
    layers = sorted((layer for layer in contacts if not layer.blind), key=lambda layer: (layer.camera, layer.annotator))
    return tuple(
        conflict
        for one, other in itertools.combinations(layers, 2)
        if one.camera == other.camera
        for conflict in find_contact_conflicts(
            one.camera, (one.annotator, other.annotator), (contacts[one], contacts[other])
        )
    )


def _without_conflicts(
    layer: Layer, contacts: Sequence[ContactLabel], conflicts: Sequence[ContactConflict], prefer: str | None
) -> tuple[ContactLabel, ...]:
    """The contacts of a layer that are in no conflict, or preferred."""
    if layer.blind:
        return tuple(contacts)
    dropped_us = {
        t_us
        for conflict in conflicts
        if conflict.camera == layer.camera
        for name, t_us in zip(conflict.annotators, conflict.times_us, strict=True)
        if name == layer.annotator != prefer
    }
    return tuple(contact for contact in contacts if contact.t_us not in dropped_us)


def _add_source(source: Path, pile: _Accumulator) -> str:
    """Add the labels of a store to the pile; the recording that they are of."""
    found = read_store(source)
    for layer, labels in found.layers.items():
        pile.add(layer, labels.values())
        pile.add_first(layer, found.first[layer].values())
        pile.add_contacts(layer, found.contacts[layer])
        pile.add_deleted(layer, found.deleted[layer])
    pile.notes += found.notes
    return found.recording_uuid


def _is_left_out(dropped: set[tuple[str, int, str]], layer: Layer, label: Label) -> bool:
    return (layer.camera, label.t_us, layer.annotator) in dropped


Contacts = Mapping[Layer, Sequence[ContactLabel]]


def _write(
    out: Path,
    uuid: str,
    layers: dict[Layer, list[Label]],
    first: Mapping[Layer, Mapping[int, Label]],
    contacts: Contacts,
) -> None:
    try:
        with replacing(out, durable=True) as partial:
            _fill(partial, out, uuid, layers, first, contacts)
    except OSError as error:
        raise LabelError("cannot write the merged labels", got=error.strerror, where=out) from error


def _fill(
    partial: Path,
    out: Path,
    uuid: str,
    layers: dict[Layer, list[Label]],
    first: Mapping[Layer, Mapping[int, Label]],
    contacts: Contacts,
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
            add_edit(db, writer, labels, before.keys() - now.keys(), put_contacts=contacts[layer])
