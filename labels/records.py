"""What a line of a journal of version 1 says: a record, and the labels in it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from core.errors import LabelError
from core.text import parse_json
from labels.model import Label, LabelState, PositionSource, Provenance

Json = Mapping[str, object]
_STATES: dict[object, LabelState] = {state.value: state for state in LabelState}
_SOURCES: dict[object, PositionSource] = {source.value: source for source in PositionSource}


def unpack_line(line: bytes) -> dict[str, object]:
    """The record of a whole line.

    Raises:
        LabelError: if it is none: something else than this program wrote it.
    """
    try:
        record = parse_json(line)
    except ValueError as error:
        raise LabelError("a line of labels that is not JSON", got=str(error)) from error
    if not isinstance(record, dict):
        raise LabelError("a line of labels that is no record", got=type(record).__name__)
    return record


def label_from_json(values: Json) -> Label:
    """A label of a journal. A radius of 0, which says nothing, becomes one that is not known.

    Raises:
        LabelError: if a value is missing or impossible.
    """
    try:
        return _label_from_json(values)
    except (KeyError, TypeError, ValueError) as error:
        raise LabelError("not a label", got=repr(error)) from error


def _label_from_json(values: Json) -> Label:
    cov, window = values.get("cov"), values.get("window_us")
    if not isinstance(values["t_us"], int):
        raise TypeError("t_us must be a whole number")
    provenance = Provenance(
        source=_SOURCES[values["source"]],
        annotator=str(values["by"]),
        made_at_us=_whole(values["at_us"]),
        tool=str(values["tool"]),
        detector=str(values.get("detector", "")),
        window_us=None if window is None else _pair(window),
        rendering=str(values.get("rendering", "")),
        time_spent_ms=_whole(values.get("spent_ms", 0)),
    )
    return Label(
        t_us=values["t_us"],
        state=_STATES[values["state"]],
        x_px=_number(values.get("x")),
        y_px=_number(values.get("y")),
        r_px=_radius(values.get("r")),
        covariance_px2=None if cov is None else _triple(cov),
        provenance=provenance,
    )


def _whole(value: object) -> int:
    if not isinstance(value, int):
        raise TypeError(f"{value!r} is not a whole number")
    return value


def _number(value: object) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"{value!r} is not a number")
    return float(value)


def _radius(value: object) -> float | None:
    radius = _number(value)
    return radius if radius is not None and math.isfinite(radius) and radius > 0 else None


def _pair(values: object) -> tuple[int, int]:
    if not isinstance(values, list) or len(values) != 2:
        raise ValueError(f"{values!r} is not a pair")
    return _whole(values[0]), _whole(values[1])


def _triple(values: object) -> tuple[float, float, float]:
    if not isinstance(values, list) or len(values) != 3:
        raise ValueError(f"{values!r} is not three numbers")
    return float(values[0]), float(values[1]), float(values[2])
