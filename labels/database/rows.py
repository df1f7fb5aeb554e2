"""A label as a row of `changes`, and back."""

from __future__ import annotations

import sqlite3
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError
from labels.arrays import SOURCES, STATES, LabelArrays, arrays_of_columns
from labels.model import Label, LabelState, PositionSource, Provenance

Values = tuple[str | float | int | None, ...]
PROVENANCE_COLUMNS: Final = (
    "source",
    "annotator",
    "made_at_us",
    "tool",
    "detector",
    "window_start_us",
    "window_end_us",
    "rendering",
    "time_spent_ms",
)
"""What `values_of_provenance` gives, in order: how a label of a ball or of a contact came about."""
COLUMNS: Final = ("state", "x_px", "y_px", "r_px", "cov_xx_px2", "cov_xy_px2", "cov_yy_px2", *PROVENANCE_COLUMNS)
"""What a change says of its time, in order."""
NO_LABEL: Final[Values] = (None,) * len(COLUMNS)
"""The change that makes a time unchecked again."""
LISTED: Final = ", ".join(COLUMNS)
_NOTHING: Final = 255
_ROW: Final = np.dtype(
    [("t_us", "i8"), ("state", "u1"), ("source", "u1"), ("x_px", "f8"), ("y_px", "f8"), ("r_px", "f8")]
)


def _index(column: str, names: tuple[str, ...]) -> str:
    """SQL for the place of a text in a list."""
    whens = " ".join(f"WHEN '{name}' THEN {at}" for at, name in enumerate(names))
    return f"CASE {column} {whens} ELSE {_NOTHING} END"


_EVERYTHING: Final = (
    f"SELECT t_us, {_index('state', STATES)}, {_index('source', SOURCES)}, "
    "ifnull(x_px, 9e999), ifnull(y_px, 9e999), ifnull(r_px, 9e999) "
    "FROM changes WHERE layer = ? AND edit <= ? ORDER BY t_us, edit"
)


def values_of(label: Label) -> Values:
    """The columns of a label, without its time."""
    return (
        label.state.value,
        label.x_px,
        label.y_px,
        label.r_px,
        *(label.covariance_px2 or (None, None, None)),
        *values_of_provenance(label.provenance),
    )


def values_of_provenance(made: Provenance) -> Values:
    """The nine columns with which a change ends, of a label as of a contact."""
    return (
        made.source.value,
        made.annotator,
        made.made_at_us,
        made.tool,
        made.detector,
        *(made.window_us or (None, None)),
        made.rendering,
        made.time_spent_ms,
    )


def provenance_of(values: Values) -> Provenance:
    """The provenance that `values_of_provenance` took apart.

    Raises:
        ValueError: if a value is impossible.
    """
    source, by, at_us, tool, detector, begin, end, rendering, spent = values
    return Provenance(
        source=PositionSource(source),
        annotator=str(by),
        made_at_us=int(at_us or 0),
        tool=str(tool or ""),
        detector=str(detector or ""),
        window_us=None if begin is None or end is None else (int(begin), int(end)),
        rendering=str(rendering or ""),
        time_spent_ms=int(spent or 0),
    )


def label_of(t_us: int, values: Values) -> Label:
    """The label that `values_of` took apart.

    Raises:
        LabelError: if a value is impossible: something else than this program wrote it.
    """
    state, x, y, r, xx, xy, yy, *made = values
    try:
        provenance = provenance_of(tuple(made))
        return Label(
            t_us=t_us,
            state=LabelState(state),
            x_px=_number(x),
            y_px=_number(y),
            r_px=_number(r),
            covariance_px2=None if xx is None or xy is None or yy is None else (float(xx), float(xy), float(yy)),
            provenance=provenance,
        )
    except ValueError as error:
        raise LabelError("not a label", got=error, where=f"label at {t_us} us") from error


def current_arrays(db: sqlite3.Connection, layer: int, *, upto: int) -> LabelArrays:
    """Every label of a layer as it was after the edit `upto`, as sorted columns: 200,000 in a quarter of a second.

    Raises:
        LabelError: if there is a source that nobody knows.
    """
    rows = np.fromiter(db.execute(_EVERYTHING, (layer, upto)), _ROW)
    if (rows["t_us"][1:] < rows["t_us"][:-1]).any():  # pages of the file have changed places
        raise sqlite3.DatabaseError("rows out of order")
    last = np.ones(len(rows), np.bool_)
    last[:-1] = rows["t_us"][1:] != rows["t_us"][:-1]  # what was said last of each time
    rows = rows[last & (rows["state"] != _NOTHING)]
    if np.any(rows["source"] == _NOTHING):
        raise LabelError("labels whose source nobody knows")
    numbers = (np.where(np.isfinite(rows[name]), rows[name], np.nan) for name in ("x_px", "y_px", "r_px"))
    columns = (rows[name].copy() for name in ("state", "source"))
    return arrays_of_columns(rows["t_us"].copy(), *numbers, *columns)


def current_rows(db: sqlite3.Connection, layer: int, *, upto: int) -> sqlite3.Cursor:
    """(t_us, edit, every column) of every label of a layer as it was after the edit `upto`, by time."""
    # SQLite takes bare columns from the row that has the maximum: what was said last.
    return db.execute(
        f"SELECT t_us, max(edit), {LISTED} FROM changes WHERE layer = ? AND edit <= ? "
        "GROUP BY t_us HAVING state IS NOT NULL",
        (layer, upto),
    )


def deletions(db: sqlite3.Connection, layer: int, table: str = "changes", column: str = "state") -> dict[int, int]:
    """Times whose label was taken away, with when that was; what a merge left out was not taken away by anybody."""
    rows = db.execute(
        f"SELECT t_us, max(edit), {table}.{column}, edits.made_at_us, edits.tool FROM {table} JOIN edits USING (edit) "
        f"WHERE {table}.layer = ? GROUP BY t_us HAVING {table}.{column} IS NULL AND edits.tool != ?",
        (layer, MERGE_TOOL),
    )
    return {row[0]: row[3] for row in rows}


def changes_since(db: sqlite3.Connection, layer: int, edit: int, *, most: int) -> list[tuple[int, Values]]:
    """What was said last of the times that were changed after an edit; so many of them at most."""
    rows = db.execute(
        f"SELECT t_us, max(edit), {LISTED} FROM changes INDEXED BY changes_of_edit WHERE edit > ? AND layer = ? "
        "GROUP BY t_us LIMIT ?",
        (edit, layer, most),
    )
    return [(row[0], row[2:]) for row in rows]


def value_at(db: sqlite3.Connection, layer: int, t_us: int, *, upto: int) -> Values | None:
    """What is said of one time after the edit `upto`; None: it is unchecked."""
    row = db.execute(
        f"SELECT {LISTED} FROM changes WHERE layer = ? AND t_us = ? AND edit <= ? ORDER BY edit DESC LIMIT 1",
        (layer, t_us, upto),
    ).fetchone()
    return None if row is None or row[0] is None else row


def value_before_settling(db: sqlite3.Connection, layer: int, t_us: int, *, upto: int) -> Values | None:
    """The newest label of one time, up to the edit `upto`, that settles no conflict; None: there was none."""
    return db.execute(
        f"SELECT {LISTED} FROM changes WHERE layer = ? AND t_us = ? AND edit <= ? AND state IS NOT NULL "
        "AND source <> ? ORDER BY edit DESC LIMIT 1",
        (layer, t_us, upto, PositionSource.SETTLED.value),
    ).fetchone()


MERGE_TOOL: Final = "rallyscope labels merge"
"""What an edit says that puts stores together, and leaves out labels in conflict."""


def times_settled(db: sqlite3.Connection, layer: int, *, upto: int) -> NDArray[np.int64]:
    """Times, ascending, at which a layer no longer says what its annotator said first, after the edit `upto`.

    There the label settles a conflict, or a merge left it out because it was in one.
    """
    rows = db.execute(
        "SELECT t_us FROM (SELECT t_us, max(edit) AS edit, state, source FROM changes WHERE layer = ? AND edit <= ? "
        "GROUP BY t_us) JOIN edits USING (edit) WHERE source = ? OR (state IS NULL AND tool = ?) ORDER BY t_us",
        (layer, upto, PositionSource.SETTLED.value, MERGE_TOOL),
    )
    return np.array([row[0] for row in rows], np.int64)


def values_before_settling(db: sqlite3.Connection, layer: int, *, upto: int) -> list[tuple[int, Values | None]]:
    """(time, `value_before_settling`) of every time of `times_settled`."""
    times = times_settled(db, layer, upto=upto).tolist()
    return [(t_us, value_before_settling(db, layer, t_us, upto=upto)) for t_us in times]


def times_by_others(db: sqlite3.Connection, layer: int, annotator: str, *, upto: int) -> NDArray[np.int64]:
    """Times, ascending, whose label after the edit `upto` names somebody else than this annotator."""
    rows = db.execute(
        "SELECT t_us, max(edit), state, annotator FROM changes WHERE layer = ? AND edit <= ? "
        "GROUP BY t_us HAVING state IS NOT NULL AND annotator NOT IN ('', ?)",
        (layer, upto, annotator),
    )
    return np.array([row[0] for row in rows], np.int64)


def _number(value: str | float | int | None) -> float | None:
    return None if value is None else float(value)
