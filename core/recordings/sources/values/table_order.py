"""The order of columns in a table that does not name them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError


@dataclass(frozen=True, slots=True)
class TableOrder:
    """Where each column is, and whether its times count seconds."""

    places: dict[str, int]
    seconds: bool

    def note(self, name: str) -> str:
        """What is said of a file of this name whose columns are in this order."""
        order = " ".join(sorted(self.places, key=lambda column: self.places[column]))
        return f"{name} does not name its columns; {order} is assumed, by their values."


def guess_columns(sample: NDArray, *, where: str) -> TableOrder:
    """Time is the column that never decreases and spans most, polarity the one of 0, 1 and -1; x stands before y.

    Times with fractions count seconds, whole ones microseconds.

    Raises:
        RecordingError: if there are no such columns.
    """
    values = np.asarray(sample, np.float64)
    columns = range(values.shape[1])
    polarity = [i for i in columns if np.isin(values[:, i], (-1, 0, 1)).all()]
    rising = [i for i in columns if (np.diff(values[:, i]) >= 0).all()]
    times = sorted((i for i in rising if i in (0, 2, 3)), key=lambda i: -float(np.ptp(values[:, i]) + values[0, i]))
    # a few events may be constant in every column: the last column is the polarity then, or the one before a last time
    time = times[0] if times else None
    p = next((i for i in (3, 2) if i in polarity and i != time), None)
    if len(columns) != 4 or time is None or p is None:
        raise RecordingError(
            "the four columns are not recognised",
            expected="t x y p or x y p t with times that never decrease, or x y t p",
            where=where,
            remedy="name the columns in a first line: t,x,y,p",
        )
    x, y = (i for i in columns if i not in (time, p))
    fractions = bool((values[:, time] != np.floor(values[:, time])).any())
    return TableOrder({"t": time, "x": x, "y": y, "p": p}, fractions)
