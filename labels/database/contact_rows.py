"""A contact as a row of `contact_changes`, and back."""

from __future__ import annotations

import sqlite3
from typing import Final, NamedTuple

from core.errors import LabelError
from labels.database.rows import PROVENANCE_COLUMNS, Values, deletions, provenance_of, values_of_provenance
from labels.database.schema import holds_contacts
from labels.model import ContactKind, ContactLabel

CONTACT_COLUMNS: Final = ("kind", "sigma_us", *PROVENANCE_COLUMNS)
"""What a change says of its time, in order."""
NO_CONTACT: Final[Values] = (None,) * len(CONTACT_COLUMNS)
"""The change that takes a contact away, or a rejection back."""
LISTED_CONTACT: Final = ", ".join(CONTACT_COLUMNS)


def values_of_contact(contact: ContactLabel) -> Values:
    """The columns of a contact, without its time."""
    return (contact.kind.value, contact.sigma_us, *values_of_provenance(contact.provenance))


def contact_of(t_us: int, values: Values) -> ContactLabel:
    """The contact that `values_of_contact` took apart.

    Raises:
        LabelError: if a value is impossible: something else than this program wrote it.
    """
    kind, sigma, *made = values
    try:
        provenance = provenance_of(tuple(made))
        sigma_us = None if sigma is None else float(sigma)
        return ContactLabel(t_us=t_us, kind=ContactKind(kind), sigma_us=sigma_us, provenance=provenance)
    except ValueError as error:
        raise LabelError("not a contact", got=error, where=f"contact at {t_us} us") from error


def values_of_rejection(contact: ContactLabel) -> Values:
    """The change that says of a proposed contact: there is none at its time.

    It has no kind, as a contact that was taken away has none: programs that know of no rejections read it as that.
    """
    return (None, *values_of_contact(contact)[1:])


def current_rejections(db: sqlite3.Connection, layer: int, *, upto: int) -> list[int]:
    """Times of the proposed contacts of a layer that were rejected as of the edit `upto`, ascending."""
    if not holds_contacts(db):
        return []
    rows = db.execute(
        "SELECT t_us, max(edit), kind, source FROM contact_changes WHERE layer = ? AND edit <= ? "
        "GROUP BY t_us HAVING kind IS NULL AND source IS NOT NULL ORDER BY t_us",
        (layer, upto),
    )
    return [row[0] for row in rows]


def current_contacts(db: sqlite3.Connection, layer: int, *, upto: int) -> list[tuple[int, Values]]:
    """(time, columns) of every contact of a layer as it was after the edit `upto`, by time."""
    if not holds_contacts(db):
        return []
    rows = db.execute(
        f"SELECT t_us, max(edit), {LISTED_CONTACT} FROM contact_changes WHERE layer = ? AND edit <= ? "
        "GROUP BY t_us HAVING kind IS NOT NULL ORDER BY t_us",
        (layer, upto),
    )
    return [(row[0], row[2:]) for row in rows]


class DeletedTimes(NamedTuple):
    """Times of labels, and of contacts, that were taken away, with when they were, us since 1970."""

    labels_us: dict[int, int]
    contacts_us: dict[int, int]


def deleted_times(db: sqlite3.Connection, layer: int) -> DeletedTimes:
    """What of a layer was taken away."""
    contacts_us = deletions(db, layer, "contact_changes", "kind") if holds_contacts(db) else {}
    return DeletedTimes(deletions(db, layer), contacts_us)


def contact_at(db: sqlite3.Connection, layer: int, t_us: int, *, upto: int) -> Values | None:
    """The contact or the rejection of one time after the edit `upto`; None: nothing is said of it."""
    row = db.execute(
        f"SELECT {LISTED_CONTACT} FROM contact_changes WHERE layer = ? AND t_us = ? AND edit <= ? "
        "ORDER BY edit DESC LIMIT 1",
        (layer, t_us, upto),
    ).fetchone()
    return None if row is None or row == NO_CONTACT else row
