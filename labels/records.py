"""One line of the journal: JSON with a checksum at its end, so that a damaged line is known from a whole one."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping

from core.errors import LabelError
from labels.model import Label, LabelState, PositionSource, Provenance

SCHEMA = 1
"""Version of the lines. A reader refuses later ones; earlier ones it must go on to understand."""
Json = Mapping[str, object]
_STATES: dict[object, LabelState] = {state.value: state for state in LabelState}
_SOURCES: dict[object, PositionSource] = {source.value: source for source in PositionSource}
_CRC = b',"crc":"'


def pack_line(record: Json) -> bytes:
    """A record as a line of the journal, with its newline."""
    text = json.dumps(record, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    head = text[:-1].encode()
    return b'%b%b%08x"}\n' % (head, _CRC, zlib.crc32(head))


def is_whole(line: bytes) -> bool:
    """Whether a line without its newline is as it was written."""
    head, mark, tail = line.rpartition(_CRC)
    return bool(mark) and len(tail) == 10 and tail == b'%08x"}' % zlib.crc32(head)


def unpack_line(line: bytes) -> dict[str, object]:
    """The record of a whole line.

    Raises:
        LabelError: if it is none: something else than this program wrote it.
    """
    try:
        record = json.loads(line)
    except ValueError as error:
        raise LabelError("a line of labels that is not JSON", got=str(error)) from error
    if not isinstance(record, dict):
        raise LabelError("a line of labels that is no record", got=type(record).__name__)
    return record


def label_to_json(label: Label) -> dict[str, object]:
    """A label as plain values; what it does not know is left out."""
    made = label.provenance
    return {
        "t_us": label.t_us,
        "state": label.state.value,
        **({} if label.x_px is None else {"x": label.x_px, "y": label.y_px}),
        **({} if label.r_px is None else {"r": label.r_px}),
        **({} if label.covariance_px2 is None else {"cov": list(label.covariance_px2)}),
        "source": made.source.value,
        "by": made.annotator,
        "at_us": made.made_at_us,
        "tool": made.tool,
        **({"detector": made.detector} if made.detector else {}),
        **({} if made.window_us is None else {"window_us": list(made.window_us)}),
        **({"rendering": made.rendering} if made.rendering else {}),
        **({"spent_ms": made.time_spent_ms} if made.time_spent_ms else {}),
    }


def label_from_json(values: Json) -> Label:
    """The label that `label_to_json` wrote.

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
        r_px=_number(values.get("r")),
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


def _pair(values: object) -> tuple[int, int]:
    if not isinstance(values, list) or len(values) != 2:
        raise ValueError(f"{values!r} is not a pair")
    return _whole(values[0]), _whole(values[1])


def _triple(values: object) -> tuple[float, float, float]:
    if not isinstance(values, list) or len(values) != 3:
        raise ValueError(f"{values!r} is not three numbers")
    return float(values[0]), float(values[1]), float(values[2])
