"""The journals in which version 1 kept labels: read, so that they can be taken over, and never written.

A journal is lines of JSON that end with a checksum, each a record with labels in it. A line torn by a kill was never
acknowledged.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

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


FORMAT: Final = "rallyscope-labels"
SCHEMA: Final = 1
_CRC: Final = b',"crc":"'


@dataclass(frozen=True, slots=True)
class JournalLines:
    """What a journal holds."""

    whole: tuple[bytes, ...]
    """Every line that is as it was written."""
    damaged: tuple[int, ...]
    """Numbers (from 1) of damaged lines with good ones behind them: bit rot or a foreign editor, never a kill."""

    @property
    def records(self) -> Iterator[dict[str, object]]:
        """What the lines say, one after the other.

        Raises:
            LabelError: at a line that no version of this program has written.
        """
        return map(unpack_line, self.whole)


def read_journal(path: Path) -> JournalLines:
    """Every whole line.

    Raises:
        LabelError: if the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LabelError("cannot read the labels", got=error.strerror, where=path) from error
    whole: list[bytes] = []
    suspects: list[int] = []
    damaged: list[int] = []
    for number, line in enumerate(content.split(b"\n")[:-1], start=1):
        if not is_whole(line):
            suspects.append(number)
            continue
        damaged += suspects  # a good line behind them: they are not a torn end
        suspects.clear()
        whole.append(line)
    return JournalLines(tuple(whole), tuple(damaged))


def is_whole(line: bytes) -> bool:
    """Whether a line without its newline is as it was written."""
    head, mark, tail = line.rpartition(_CRC)
    return bool(mark) and len(tail) == 10 and tail == b'%08x"}' % zlib.crc32(head)
