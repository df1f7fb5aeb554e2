"""What tables of other tools have in common: names and units of columns, separators, numbers, odd rows. A rule each.

A rule that a public report made necessary names it as GitHub does: owner/repository#number.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Collection, Iterable, Sequence
from typing import Final, Literal

UNITS_US: Final = {"ns": 1e-3, "us": 1.0, "ms": 1e3, "s": 1e6}
"""Unit of time -> microseconds."""
UNIT_KEYS: Final = ("unit", "units", "time_unit", "time_units", "t_unit", "timestamp_unit", "timestamps_unit")
"""Attributes, and arrays of one word, that state the unit of times."""
UNIT_NAMES: Final = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds", "s": "seconds"}
Unit = Literal["m", "mm", "cm"]
METRES: Final[dict[str, float]] = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
"""Unit of length -> metres."""
_TIME_WORDS: Final = {
    "ns": "ns", "nsec": "ns", "nanosec": "ns", "nanosecond": "ns",
    "us": "us", "usec": "us", "microsec": "us", "microsecond": "us",
    "ms": "ms", "msec": "ms", "millisec": "ms", "millisecond": "ms", "s": "s", "sec": "s", "second": "s",
}  # fmt: skip
_LENGTH_WORDS: Final[dict[str, Unit]] = {
    "m": "m", "meter": "m", "metre": "m", "mm": "mm", "millimeter": "mm", "millimetre": "mm",
    "cm": "cm", "centimeter": "cm", "centimetre": "cm",
}  # fmt: skip
_UNITS: Final = "|".join(f"{word}s?" if len(word) > 2 else word for word in _TIME_WORDS)
_JOINTS: Final = re.compile(r"[\s_\-\[(/.:]+")
NO_NUMBER: Final = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "--"})
"""Cells without a value, in small letters: those of pandas, R and spreadsheets."""
_DECIMAL_COMMA: Final = re.compile(r"\s*[-+]?(?:\d+,\d*|,\d+)(?:e[-+]?\d+)?\s*", re.IGNORECASE)
CAMERA_NAMES: Final = (
    "camera", "cam", "camera_id", "cam_id", "camera_name", "cam_name", "sensor", "sensor_id", "device_id",
)  # fmt: skip
"""Columns whose values tell cameras apart."""
ODD_SHARE: Final = 0.01
FEW_ODD: Final = 3
"""So many odd rows are never too many: a tiny file may have one."""


def time_unit(word: str) -> str | None:
    """The unit of time that a word means, such as "ms" for "Milliseconds"; None if it is none."""
    plain = _plain(word)
    return _TIME_WORDS.get(plain) or _TIME_WORDS.get(plain.removesuffix("s"))


def length_unit(word: str) -> Unit | None:
    """The unit of length that a word means, such as "mm" for "millimetres"; None if it is none."""
    plain = word.strip().lower()
    return _LENGTH_WORDS.get(plain) or _LENGTH_WORDS.get(plain.removesuffix("s"))


def spelled(name: str) -> str:
    """A column's name in small letters, its words joined by underscores: "t_us" for "T [µs]"."""
    return _JOINTS.sub("_", _plain(name.strip("\ufeff\"'#%/; \t\r\n")).rstrip("])"))


def split_unit(name: str, stems: str, *, joined: bool = False) -> tuple[str, str | None] | None:
    """The stem of a column of times and the unit at its end: ("t", "ms") for "t_ms" and "t [ms]"; None without a stem.

    Args:
        name: of the column.
        stems: pattern of the names of times, in small letters.
        joined: whether the unit may follow without anything between, as in "tms".
    """
    found = re.fullmatch(rf"({stems})(?:_{'?' if joined else ''}({_UNITS}))?", spelled(name))
    return None if found is None else (found[1], None if found[2] is None else time_unit(found[2]))


def without_unit(name: str) -> tuple[str, str | None]:
    """A spelled name without the unit of time at its end, and that unit: ("stamp", "us") for "stamp_us"."""
    found = _unit_at_end().search(name)
    return (name, None) if found is None else (name[: found.start()], time_unit(found[1]))


@functools.cache
def _unit_at_end() -> re.Pattern[str]:
    return re.compile(rf"_({_UNITS})$")


def separator_of(text: str) -> str:
    """What separates the columns of a table: a comma, unless its first line has none, but semicolons or tabs."""
    first = text.lstrip("\r\n").split("\n", 1)[0]
    return "," if "," in first else next((sign for sign in ";\t" if sign in first), ",")


def with_point(text: str) -> str:
    """A number with a decimal point for its decimal comma; other texts as they are (timeseer-ai/kukur#279)."""
    return text.replace(",", ".") if _DECIMAL_COMMA.fullmatch(text) else text


def several_values(header: Sequence[str], rows: Iterable[Sequence[str]], names: Collection[str]) -> str | None:
    """The column, of those with these names, whose cells differ, and some of them; None if each has one value.

    It tells apart what cannot be one track, such as cameras; rows of another length say nothing.
    """
    rows = [row for row in rows if len(row) == len(header)]
    for at, name in enumerate(header):
        values = {row[at].strip() for row in rows} if spelled(name) in names else set[str]()
        if len(values) > 1:
            return f"{name} = {', '.join(sorted(values)[:8])}"
    return None


def allowed_odd(rows: int) -> float:
    """How many odd ones of so many rows are damage and left out; more, and it is not the rows that are wrong."""
    return max(FEW_ODD, ODD_SHARE * rows)


def _plain(word: str) -> str:
    return word.strip().lower().replace("µ", "u").replace("μ", "u")
