"""A label as one flat row: the columns of plain CSV and of HDF5, which lose nothing."""

from __future__ import annotations

from typing import Final

from core.errors import LabelError
from labels.formats.exchange import finite
from labels.model import Label, LabelState, PositionSource, Provenance

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


def flat_row(label: Label) -> dict[str, Value]:
    """Every column of a label; None where it says nothing."""
    made = label.provenance
    xx, xy, yy = label.covariance_px2 or (None, None, None)
    start, end = made.window_us or (None, None)
    return {
        "t_us": label.t_us,
        "state": label.state.value,
        "x_px": label.x_px,
        "y_px": label.y_px,
        "r_px": label.r_px,
        "cov_xx_px2": xx,
        "cov_xy_px2": xy,
        "cov_yy_px2": yy,
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


def label_of_row(row: dict[str, str], origin: str) -> Label:
    """The label of a row of texts; columns may be absent or empty, except time and state.

    Raises:
        LabelError: if a value is missing or impossible.
    """

    def number(name: str) -> float | None:
        return finite(row[name], name) if row.get(name) else None

    def whole(name: str, default: int = 0) -> int:
        return _whole(row[name], name) if row.get(name) else default

    xx, xy, yy = number("cov_xx_px2"), number("cov_xy_px2"), number("cov_yy_px2")
    covariance = None if xx is None or xy is None or yy is None else (xx, xy, yy)
    window = None
    if row.get("window_start_us") and row.get("window_end_us"):
        window = (whole("window_start_us"), whole("window_end_us"))
    provenance = Provenance(
        source=PositionSource(row["source"]) if row.get("source") else PositionSource.IMPORTED,
        annotator=row.get("annotator", ""),
        made_at_us=whole("made_at_us"),
        tool=row.get("tool", ""),
        detector=row.get("detector") or origin,
        window_us=window,
        rendering=row.get("rendering", ""),
        time_spent_ms=whole("time_spent_ms"),
    )
    return Label(
        t_us=_whole(row["t_us"], "t_us"),
        state=_state(row["state"]),
        x_px=number("x_px"),
        y_px=number("y_px"),
        r_px=number("r_px"),
        covariance_px2=covariance,
        provenance=provenance,
    )


def _state(text: str) -> LabelState:
    try:
        return LabelState(text)
    except ValueError as error:
        raise LabelError("unknown state", expected=f"one of {', '.join(LabelState)}", got=repr(text)[:80]) from error


def _whole(text: str, name: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise LabelError(f"{name} is not a whole number", got=repr(text)[:80]) from error
