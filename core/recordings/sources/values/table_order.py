"""The order of columns in a table that does not name them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError

_USUAL: Final = ("txyp", "xypt", "xytp")
_PAIRS: Final = ((-1, 0, 1), (0, 255), (1, 255), (1, 2**16 - 1), (1, 2**32 - 1))
_ENOUGH_ROWS: Final = 20
"""From so many rows on it can be told which of two rising columns is the time, and which takes two values only."""
_FEW_VALUES: Final = 4
_ODD_SHARE: Final = 0.01
_MOSTLY: Final = 0.9
_LARGEST_PX: Final = 4096


@dataclass(frozen=True, slots=True)
class TableOrder:
    """Where each column is, and whether its times count seconds."""

    places: dict[str, int]
    seconds: bool

    @property
    def text(self) -> str:
        """The columns in their order: "t, x, y, p"."""
        return ", ".join(sorted(self.places, key=self.places.__getitem__))

    def note(self, name: str) -> str:
        """What is said of a file of this name whose columns are in this order."""
        return f"{name} does not name its columns; they are taken for {self.text}, by their values."


def guess_columns(sample: NDArray, *, where: str) -> TableOrder:
    """Time is the column that never decreases and spans most, polarity the one of two values; x stands before y.

    Times that are only nearly in order (late rows, a clock that begins again) are told by their long-term rise. Times
    with fractions count seconds, whole ones microseconds.

    Raises:
        RecordingError: if there are no such columns, or more than one order fits.
    """
    values = np.asarray(sample, np.float64)
    if not len(values):
        raise RecordingError("the table has no rows", where=where)
    polarity = _polarities(values) if values.shape[1] == 4 else []
    for times in (_never_decreasing(values), _mostly_rising(values)):
        fits = [(t, p) for t in times for p in polarity if t != p]
        usual = [pair for pair in fits if _spelled(pair) in _USUAL]
        # In few rows any column may ascend or have two values: only the orders that are in use count then.
        chosen = usual or (fits if len(values) >= _ENOUGH_ROWS else [])
        if chosen:
            time, p = chosen[0]
            _refuse_ambiguous(values, chosen, usual=bool(usual), where=where)
            x, y = (i for i in range(4) if i not in (time, p))
            fractions = bool((values[:, time] != np.floor(values[:, time])).any())
            return TableOrder({"t": time, "x": x, "y": y, "p": p}, fractions)
    raise RecordingError(
        "the four columns are not recognised",
        expected="t x y p or x y p t with times that never decrease, or x y t p",
        where=where,
        remedy="name the columns in a first line: t,x,y,p",
    )


def _spelled(pair: tuple[int, int]) -> str:
    letters = iter("xy")
    return "".join("t" if i == pair[0] else "p" if i == pair[1] else next(letters) for i in range(4))


def _refuse_ambiguous(values: NDArray, fits: list[tuple[int, int]], *, usual: bool, where: str) -> None:
    """Two columns that rise and could both be addresses: which is the time cannot be told."""
    times = list(dict.fromkeys(t for t, _ in fits))
    plain = [t for t in times if _could_be_addresses(values[:, t])]
    if (len(times) > 1 and len(plain) == len(times)) or (not usual and len(fits) > 1):
        shown = " or ".join(dict.fromkeys(" ".join(_spelled(pair)) for pair in fits))
        remedy = "name the columns in a first line: t,x,y,p"
        raise RecordingError("the order of the four columns cannot be told", got=shown, where=where, remedy=remedy)


def _could_be_addresses(column: NDArray) -> bool:
    return bool((column < _LARGEST_PX).all() and (column >= 0).all() and (column == np.floor(column)).all())


def _polarities(values: NDArray) -> list[int]:
    """Columns that can be polarities, the likeliest first: at the end of the row, before the end, elsewhere."""
    likeliest = sorted(range(4), key=lambda i: (3, 2, 0, 1).index(i))
    known = [i for i in likeliest if any(np.isin(values[:, i], pair).all() for pair in _PAIRS)]
    if known or len(values) < _ENOUGH_ROWS:
        return known
    for most in (2, _FEW_VALUES):
        few = [i for i in likeliest if _covered(values[:, i], most) >= 1 - _ODD_SHARE]
        if few:
            return few
    return []


def _covered(column: NDArray, most: int) -> float:
    """Share of the rows that the commonest values have."""
    counts = np.sort(np.unique(column, return_counts=True)[1])[::-1]
    return float(counts[:most].sum()) / len(column)


def _never_decreasing(values: NDArray) -> list[int]:
    rising = [i for i in range(values.shape[1]) if (np.diff(values[:, i]) >= 0).all()]
    return sorted(rising, key=lambda i: -float(np.ptp(values[:, i]) + values[0, i]))


def _mostly_rising(values: NDArray) -> list[int]:
    """The one column that rises, or falls, over the length of the table; none if there are several."""
    lag = len(values) // 10
    if len(values) < _ENOUGH_ROWS:
        return []
    found = []
    for i in range(values.shape[1]):
        column = values[:, i]
        if _covered(column, _FEW_VALUES) < _MOSTLY:
            share = float((column[lag:] > column[:-lag]).mean())
            if share >= _MOSTLY - 0.1 or share <= 1 - _MOSTLY:
                found.append(i)
    beyond = [i for i in found if not _could_be_addresses(values[:, i])]
    return beyond if len(beyond) == 1 else found if len(found) == 1 else []
