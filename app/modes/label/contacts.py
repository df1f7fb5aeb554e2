"""Bounces, hits and net touches in Label: set at the shown time, moved, removed, accepted, and shown in the time bar.

A contact is of the ball, not of a camera: those of all cameras' layers are shown together. A new one is stored with the
camera that is labelled; one that is there is changed in the layer that holds it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from app.formatting import html_text, table_row
from app.modes.label.editor import LabelEditor
from app.modes.label.label_changes import ShownPicture
from app.modes.label.labelling import Labelling
from app.panels.time_bar import ContactMark
from core.cameras import Camera
from labels.assist import Proposals
from labels.assist.contact_proposals import propose_contacts
from labels.assist.propose import joined_proposals
from labels.contacts import MATCH_US, new_contacts
from labels.model import ContactKind, ContactLabel, PositionSource
from labels.store import LabelStore

SEARCH_EVERY_US: Final = 500_000
"""So much more has the detector been through before contacts are looked for again."""
CONTEXT_US: Final = 1_000_000
"""Path before that, which is looked at with it: a contact is judged by the flights on both its sides."""
NO_CONTACTS: Final = (
    "No proposed contact",
    "I runs the detector from the cursor on; two calibrated cameras are needed.",
)


def contact_near(contacts: Iterable[ContactLabel], t_us: int) -> ContactLabel | None:
    """The contact that is meant at a time: the nearest, if it can be of one event with it."""
    near = min(contacts, key=lambda contact: abs(contact.t_us - t_us), default=None)
    return near if near is not None and abs(near.t_us - t_us) <= MATCH_US else None


def contact_by_hand(kind: ContactKind, before: ContactLabel | None, picture: ShownPicture) -> ContactLabel:
    """The contact at the middle of the window that is shown; it moves the one `before`.

    All that is known of its time is the window: the standard deviation of a uniform distribution over it.
    """
    start_us, end_us = picture.window_us
    made = None if before is None else before.provenance
    proposed = made is not None and made.source in (PositionSource.ACCEPTED, PositionSource.CORRECTED)
    source = PositionSource.CORRECTED if proposed else PositionSource.BY_HAND
    return ContactLabel(
        t_us=picture.t_us,
        kind=kind,
        sigma_us=round((end_us - start_us) / math.sqrt(12), 1),
        provenance=picture.provenance(source, made.detector if made is not None and proposed else ""),
    )


def open_proposals(now: Labelling) -> tuple[ContactLabel, ...]:
    """The proposed contacts that are not labelled, by time."""
    return () if now.view.repeat else new_contacts(now.proposed_contacts, now.contacts)


# What a person does -----------------------------------------------------------------------------------------------


def set_contact(editor: LabelEditor, kind: ContactKind) -> None:
    """A contact of this kind is at the shown time; one within 10 ms is moved there."""
    now, picture = editor.labelling, _picture(editor)
    if picture is None:
        return

    def change(store: LabelStore) -> tuple[int, ...]:
        before = contact_near(store.contacts(), picture.t_us)
        if before is not None and (before.t_us, before.kind) == (picture.t_us, kind):
            return ()
        moved = () if before is None or before.t_us == picture.t_us else (before.t_us,)
        store.edit(put_contacts=(contact_by_hand(kind, before, picture),), delete_contacts=moved)
        return (picture.t_us,)

    _write(editor, _holder(now), change)


def remove_contact(editor: LabelEditor) -> None:
    """There is no contact within 10 ms of the cursor."""
    now = editor.labelling
    if contact_near(now.contacts, now.t_us) is None or now.view.repeat:
        return

    def change(store: LabelStore) -> tuple[int, ...]:
        contact = contact_near(store.contacts(), now.t_us)
        store.edit(delete_contacts=() if contact is None else (contact.t_us,))
        return () if contact is None else (contact.t_us,)

    _write(editor, _holder(now), change)


def accept_contact(editor: LabelEditor) -> None:
    """Label the contact that is proposed within 10 ms of the cursor, and go to the next; from elsewhere only go."""
    now, waiting, picture = editor.labelling, open_proposals(editor.labelling), _picture(editor)
    found = contact_near(waiting, now.t_us)
    if not waiting:
        editor.note(*NO_CONTACTS)
        return
    if found is not None:
        if picture is None:
            return  # what is not on the screen is not judged
        provenance = picture.provenance(PositionSource.ACCEPTED, found.provenance.detector)
        accepted = replace(found, provenance=provenance)

        def change(store: LabelStore) -> tuple[int, ...]:
            if not new_contacts((accepted,), store.contacts()):
                return ()
            store.edit(put_contacts=(accepted,))
            return (accepted.t_us,)

        if not _write(editor, now.view.camera, change):
            return
    _go_to_next(editor, [contact for contact in waiting if contact is not found])


def next_contact(editor: LabelEditor) -> None:
    """Go to the next contact, labelled or proposed; from the last to the first."""
    now = editor.labelling
    known = [*now.contacts, *open_proposals(now)]
    if not known:
        editor.note("No contact yet", "Shift T, O or M marks a bounce, hit or net touch here; I looks for them.")
    _go_to_next(editor, known)


def _go_to_next(editor: LabelEditor, contacts: Sequence[ContactLabel]) -> None:
    times = sorted(contact.t_us for contact in contacts)
    if times:
        editor.go_to(next((t_us for t_us in times if t_us > editor.labelling.t_us), times[0]))


def _picture(editor: LabelEditor) -> ShownPicture | None:
    """The picture at the cursor; None where nothing can be judged on it."""
    now = editor.labelling
    return now.judged_picture(time.monotonic()) if now.on_screen and not now.view.repeat else None


def _holder(now: Labelling) -> str:
    """The camera whose layer holds the contact at the cursor; the labelled one if there is none."""
    names = (now.view.camera, *(other.name for other in now.others))
    return next((name for name in names if contact_near(now.works[name].contacts, now.t_us)), now.view.camera)


def _write(editor: LabelEditor, camera: str, change: Callable[[LabelStore], tuple[int, ...]]) -> bool:
    if not editor.write_all({camera: change}):
        return False
    if camera != editor.labelling.view.camera:  # undo is of the labelled camera
        editor.note("Contacts", f"This one is stored with camera {camera}: choose that, and Z takes it back.")
    return True


# What is proposed -------------------------------------------------------------------------------------------------


class ContactSearch:
    """Looks for contacts in what a detector finds, as it goes on; used by the thread of that run."""

    def __init__(self, cameras: Mapping[str, Camera], start_us: int) -> None:
        self._cameras = cameras
        self._parts: dict[str, Proposals] = {}
        self._searched_us = start_us
        self._found: tuple[ContactLabel, ...] = ()

    def add(self, parts: Mapping[str, Proposals], reached_us: int, *, last: bool) -> tuple[ContactLabel, ...] | None:
        """Everything found so far, by time; None where that was not worked out again.

        `parts`: what was found next, by camera, up to `reached_us`. `last`: nothing comes after.
        """
        since_us = self._searched_us - CONTEXT_US
        for name in self._cameras.keys() & parts.keys():
            joined = joined_proposals(self._parts.get(name), parts[name])
            self._parts[name] = joined.between(since_us, reached_us + 1)
        if len(self._parts) < 2 or (reached_us - self._searched_us < SEARCH_EVERY_US and not last):
            return None
        found = propose_contacts([self._cameras[name] for name in self._parts], tuple(self._parts.values()))
        # What lies in the first half of the stretch has been judged with more of the path before it.
        from_us = since_us + CONTEXT_US // 2
        known = tuple(contact for contact in self._found if contact.t_us < from_us)
        later = tuple(contact for contact in found if contact.t_us >= from_us)
        self._found, self._searched_us = known + new_contacts(later, known), reached_us
        return self._found


# What is shown ----------------------------------------------------------------------------------------------------


def contact_marks(now: Labelling) -> tuple[ContactMark, ...]:
    """What the time bar draws: labelled contacts, and pale the proposed ones."""
    labelled = (ContactMark(one.t_us, one.sigma_us or 0.0, str(one.kind), False) for one in now.contacts)
    return *labelled, *(ContactMark(one.t_us, one.sigma_us or 0.0, str(one.kind), True) for one in open_proposals(now))


def contacts_html(now: Labelling) -> str:
    """The list of the panel: a click on a time goes there, the contact at the cursor is set off."""
    waiting = open_proposals(now)
    shown = sorted((*now.contacts, *waiting), key=lambda contact: contact.t_us)
    here = contact_near(shown, now.t_us)
    rows = []
    for contact in shown:
        style = "opacity:.55" if any(contact is one for one in waiting) else ""
        style += ";background:#3a3326" if contact is here else ""
        link = f"<button type='button' class='rallyscope-seek' data-rallyscope-seek='{contact.t_us}'>"
        time_html = f"{link}{contact.t_us / 1e6:.6f} s</button>"
        cells = time_html, str(contact.kind), _sigma_text(contact), _origin(contact, style)
        rows.append(table_row(cells, "padding:0 8px 0 0;vertical-align:top", row_style=style))
    count = f"{len(now.contacts)} labelled, {len(waiting)} proposed"
    table = f"<table>{''.join(rows)}</table>"
    return f"<div style='font-size:12.5px;padding:2px 12px;max-height:180px;overflow-y:auto'>{count}{table}</div>"


def _sigma_text(contact: ContactLabel) -> str:
    return "" if contact.sigma_us is None else f"&plusmn;{contact.sigma_us / 1e3:.2f}&nbsp;ms"


def _origin(contact: ContactLabel, style: str) -> str:
    """Who said so, and how it came about."""
    made = contact.provenance
    method = html_text(made.detector.split("#")[0])
    if "opacity" in style:
        return f"proposed by {method}"
    how = made.source.replace("_", " ")
    return f"{html_text(made.annotator)}, {how}{f' ({method})' if method else ''}"
