"""Bounces, hits and net touches in Label: set at the shown time, moved, removed, accepted, and shown in the time bar.

A contact is of the ball, not of a camera: those of all cameras' layers are shown together. A new one is stored with the
camera that is labelled; one that is there is changed in the layer that holds it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from app.formatting import html_text, table_row
from app.modes.label.comparison import short_name
from app.modes.label.editor import LabelEditor
from app.modes.label.label_changes import ShownPicture
from app.modes.label.labelling import Labelling
from app.panels.time_bar import ContactMark
from app.pictures.palette import PaletteIndex
from app.views.mosaic import css_colour
from core.cameras import Camera
from labels.assist import Proposals
from labels.assist.contact_proposals import propose_contacts
from labels.assist.propose import joined_proposals
from labels.contacts import MATCH_US, WITHIN_US, contacts_differ, match_contacts, new_contacts
from labels.model import ContactKind, ContactLabel, PositionSource
from labels.store import LabelStore

SEARCH_EVERY_US: Final = 500_000
"""So much more has the detector been through before contacts are looked for again."""
CONTEXT_US: Final = 1_000_000
"""Path before that, which is looked at with it: a contact is judged by the flights on both its sides."""
THEIRS: Final = css_colour(PaletteIndex.THEIRS, "orange / blue")
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
    """The proposed contacts that are neither labelled nor rejected, by time."""
    if now.view.repeat:
        return ()
    rejected_us = [t_us for work in now.works.values() for t_us in work.no_contacts_us]
    waiting = new_contacts(now.proposed_contacts, now.contacts)
    # Another run finds the same kink some microseconds off: what was rejected is the event, not its time.
    return tuple(one for one in waiting if all(abs(one.t_us - t_us) > MATCH_US for t_us in rejected_us))


@dataclass(frozen=True, slots=True)
class ContactDifferences:
    """What another annotator says about contacts, beside what is labelled here."""

    annotator: str
    conflicts: tuple[tuple[ContactLabel, ContactLabel], ...]
    """One's own and the other's, of one event, by time."""
    only_mine: int
    only_theirs: tuple[ContactLabel, ...]

    @property
    def theirs(self) -> tuple[ContactLabel, ...]:
        """Those of the other that are seen beside one's own, by time."""
        both = (*(theirs for _, theirs in self.conflicts), *self.only_theirs)
        return tuple(sorted(both, key=lambda contact: contact.t_us))


def contact_differences(now: Labelling) -> ContactDifferences | None:
    """Beside whom one compares with; None if that is nobody."""
    compared = now.compared_here
    if compared is None:
        return None
    theirs = compared.theirs.contacts
    pairs = match_contacts(now.contacts, theirs)
    matched = {row for _, row in pairs}
    both = ((now.contacts[mine], theirs[row]) for mine, row in pairs)
    return ContactDifferences(
        compared.theirs.annotator,
        tuple((mine, other) for mine, other in both if contacts_differ(mine, other)),
        only_mine=len(now.contacts) - len(pairs),
        only_theirs=tuple(contact for row, contact in enumerate(theirs) if row not in matched),
    )


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
    """There is no contact within 10 ms of the cursor: remove the labelled one, or else reject the proposed one."""
    now = editor.labelling
    if now.view.repeat:
        return
    if contact_near(now.contacts, now.t_us) is None:
        _reject_contact(editor)
        return

    def change(store: LabelStore) -> tuple[int, ...]:
        contact = contact_near(store.contacts(), now.t_us)
        store.edit(delete_contacts=() if contact is None else (contact.t_us,))
        return () if contact is None else (contact.t_us,)

    _write(editor, _holder(now), change)


def _reject_contact(editor: LabelEditor) -> None:
    """What is proposed within 10 ms of the cursor is wrong: it is not proposed again. Go to the next."""
    now, waiting, picture = editor.labelling, open_proposals(editor.labelling), _picture(editor)
    found = contact_near(waiting, now.t_us)
    if found is None or picture is None:
        return
    made = picture.provenance(PositionSource.BY_HAND, found.provenance.detector)
    wrong = replace(found, provenance=made)

    def change(store: LabelStore) -> tuple[int, ...]:
        store.edit(reject_contacts=(wrong,))
        return (wrong.t_us,)

    if _write(editor, now.view.camera, change):
        _go_to_next(editor, [contact for contact in waiting if contact is not found])


def accept_contact(editor: LabelEditor) -> None:
    """Label the contact that is proposed within 10 ms of the cursor, and go to the next; from elsewhere only go.

    One that only the annotator has with whom one compares is taken over as that made it.
    """
    now, differences, picture = editor.labelling, contact_differences(editor.labelling), _picture(editor)
    theirs = () if differences is None else differences.only_theirs
    waiting = (*open_proposals(now), *theirs)
    found = contact_near(waiting, now.t_us)
    if not waiting:
        editor.note(*NO_CONTACTS)
        return
    if found is not None:
        if picture is None:
            return  # what is not on the screen is not judged
        provenance = picture.provenance(PositionSource.ACCEPTED, found.provenance.detector)
        accepted = found if any(found is one for one in theirs) else replace(found, provenance=provenance)

        def change(store: LabelStore) -> tuple[int, ...]:
            if not new_contacts((accepted,), store.contacts()):
                return ()
            store.edit(put_contacts=(accepted,))
            return (accepted.t_us,)

        if not _write(editor, now.view.camera, change):
            return
    _go_to_next(editor, [contact for contact in waiting if contact is not found])


def next_contact(editor: LabelEditor) -> None:
    """Go to the next contact, labelled, proposed or another's; from the last to the first."""
    now = editor.labelling
    differences = contact_differences(now)
    known = [*now.contacts, *open_proposals(now), *(() if differences is None else differences.theirs)]
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
    """What the time bar draws: labelled contacts, and pale the proposed ones, and those that another says otherwise."""
    differences = contact_differences(now)
    pale = (*open_proposals(now), *(() if differences is None else differences.theirs))
    labelled = (ContactMark(one.t_us, one.sigma_us or 0.0, str(one.kind), False) for one in now.contacts)
    return *labelled, *(ContactMark(one.t_us, one.sigma_us or 0.0, str(one.kind), True) for one in pale)


def contacts_html(now: Labelling) -> str:
    """The list of the panel: a click on a time goes there, the contact at the cursor is set off."""
    waiting, differences = open_proposals(now), contact_differences(now)
    theirs = () if differences is None else differences.theirs
    shown = sorted((*now.contacts, *waiting, *theirs), key=lambda contact: contact.t_us)
    here = contact_near(shown, now.t_us)
    rows = []
    for contact in shown:
        style = "opacity:.55" if any(contact is one for one in waiting) else ""
        style += ";background:#3a3326" if contact is here else ""
        style += f";color:{THEIRS}" if any(contact is one for one in theirs) else ""
        link = f"<button type='button' class='rallyscope-seek' data-rallyscope-seek='{contact.t_us}'>"
        time_html = f"{link}{contact.t_us / 1e6:.6f} s</button>"
        cells = time_html, str(contact.kind), _sigma_text(contact), _origin(contact, style)
        rows.append(table_row(cells, "padding:0 8px 0 0;vertical-align:top", row_style=style))
    count = f"{len(now.contacts)} labelled, {len(waiting)} proposed"
    if differences is not None:
        name = html_text(short_name(differences.annotator))
        count += f"<br>beside {name}: {len(differences.conflicts)} differ (kind, or over {WITHIN_US / 1e3:g} ms)"
        count += f", {differences.only_mine} only yours, {len(differences.only_theirs)} only {name}'s"
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
