"""A label, or a contact, as one flat row: the columns of plain CSV, JSON and HDF5, which lose nothing."""

from __future__ import annotations

from typing import Final

from core.errors import LabelError
from labels.formats.exchange import finite, whole_number
from labels.model import ContactKind, ContactLabel, Label, LabelState, PositionSource, Provenance

Value = int | float | str | None

COLUMNS: Final = {
    "t_us": int,
    "state": str,
    "x_px": float,
    "y_px": float,
    "r_px": float,
    "cov_xx_px2": float,
    "cov_xy_px2": float,
    "cov_yy_px2": float,
    "source": str,
    "annotator": str,
    "made_at_us": int,
    "tool": str,
    "detector": str,
    "window_start_us": int,
    "window_end_us": int,
    "rendering": str,
    "time_spent_ms": int,
}
"""Name and type of each column, in order."""
REQUIRED: Final = ("t_us", "state", "x_px", "y_px")
CONTACT_COLUMNS: Final = {
    "t_us": int,
    "kind": str,
    "sigma_us": float,
    **{name: COLUMNS[name] for name in COLUMNS if list(COLUMNS).index(name) >= list(COLUMNS).index("source")},
}
"""Name and type of each column of a contact, in order."""
REQUIRED_OF_CONTACT: Final = ("t_us", "kind")


def flat_row(label: Label) -> dict[str, Value]:
    """Every column of a label; None where it says nothing."""
    xx, xy, yy = label.covariance_px2 or (None, None, None)
    return {
        "t_us": label.t_us,
        "state": label.state.value,
        "x_px": label.x_px,
        "y_px": label.y_px,
        "r_px": label.r_px,
        "cov_xx_px2": xx,
        "cov_xy_px2": xy,
        "cov_yy_px2": yy,
        **_provenance_row(label.provenance),
    }


def contact_row(contact: ContactLabel) -> dict[str, Value]:
    """Every column of a contact; None where it says nothing."""
    return {
        "t_us": contact.t_us,
        "kind": contact.kind.value,
        "sigma_us": contact.sigma_us,
        **_provenance_row(contact.provenance),
    }


def _provenance_row(made: Provenance) -> dict[str, Value]:
    start, end = made.window_us or (None, None)
    return {
        "source": made.source.value,
        "annotator": made.annotator,
        "made_at_us": made.made_at_us,
        "tool": made.tool,
        "detector": made.detector,
        "window_start_us": start,
        "window_end_us": end,
        "rendering": made.rendering,
        "time_spent_ms": made.time_spent_ms,
    }


def contact_of_row(row: dict[str, str], origin: str) -> ContactLabel:
    """The contact of a row of texts; columns may be absent or empty, except time and kind.

    Raises:
        LabelError: if a value is missing or impossible.
    """
    kind = row["kind"].strip().lower()
    if kind not in tuple(ContactKind):
        raise LabelError("unknown kind of contact", expected=f"one of {', '.join(ContactKind)}", got=repr(kind)[:80])
    return ContactLabel(
        t_us=whole_number(row["t_us"], "t_us"),
        kind=ContactKind(kind),
        sigma_us=finite(row["sigma_us"], "sigma_us") if row.get("sigma_us") else None,
        provenance=_provenance_of(row, origin),
    )


def label_of_row(row: dict[str, str], origin: str) -> Label:
    """The label of a row of texts; columns may be absent or empty, except time and state.

    Raises:
        LabelError: if a value is missing or impossible.
    """

    def number(name: str) -> float | None:
        return finite(row[name], name) if row.get(name) else None

    xx, xy, yy = number("cov_xx_px2"), number("cov_xy_px2"), number("cov_yy_px2")
    covariance = None if xx is None or xy is None or yy is None else (xx, xy, yy)
    return Label(
        t_us=whole_number(row["t_us"], "t_us"),
        state=_state(row["state"]),
        x_px=number("x_px"),
        y_px=number("y_px"),
        r_px=number("r_px"),
        covariance_px2=covariance,
        provenance=_provenance_of(row, origin),
    )


def _provenance_of(row: dict[str, str], origin: str) -> Provenance:
    def whole(name: str, default: int = 0) -> int:
        return whole_number(row[name], name) if row.get(name) else default

    window = None
    if row.get("window_start_us") and row.get("window_end_us"):
        window = (whole("window_start_us"), whole("window_end_us"))
    return Provenance(
        source=PositionSource(row["source"]) if row.get("source") else PositionSource.IMPORTED,
        annotator=row.get("annotator", ""),
        made_at_us=whole("made_at_us"),
        tool=row.get("tool", ""),
        detector=row.get("detector") or origin,
        window_us=window,
        rendering=row.get("rendering", ""),
        time_spent_ms=whole("time_spent_ms"),
    )


def _state(text: str) -> LabelState:
    try:
        return LabelState(text)
    except ValueError as error:
        raise LabelError("unknown state", expected=f"one of {', '.join(LabelState)}", got=repr(text)[:80]) from error
