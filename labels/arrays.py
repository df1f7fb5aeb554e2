"""Labels as sorted read-only columns: what drawing, scoring and export work on; each a value when asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from labels.model import Label, LabelState, PositionSource

STATES: Final = tuple(LabelState)
SOURCES: Final = tuple(PositionSource)


@dataclass(frozen=True, slots=True, eq=False)
class LabelArrays:
    """N labels of one camera, t_us strictly ascending. nan where a label has no such number."""

    t_us: NDArray[np.int64]
    x_px: NDArray[np.float64]
    y_px: NDArray[np.float64]
    r_px: NDArray[np.float64]
    state: NDArray[np.uint8]
    """Index into `STATES`."""
    source: NDArray[np.uint8]
    """Index into `SOURCES`."""

    def __len__(self) -> int:
        return len(self.t_us)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Where the ball is visible, wholly or in part."""
        return np.isin(self.state, [index for index, state in enumerate(STATES) if state.seen])

    def rows(self, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> LabelArrays:
        """A subset in the same order."""
        return _freeze(*(column[rows] for column in _columns(self)))

    def between(self, start_us: int, end_us: int) -> LabelArrays:
        """Labels with `start_us <= t < end_us`."""
        first, last = np.searchsorted(self.t_us, (start_us, end_us))
        return self.rows(slice(int(first), max(int(first), int(last))))

    def changed(self, t_us: int, label: Label | None) -> LabelArrays:
        """A copy with the label at `t_us` replaced, added, or removed (None)."""
        row = int(np.searchsorted(self.t_us, t_us))
        present = row < len(self) and int(self.t_us[row]) == t_us
        if label is None:
            return _freeze(*(np.delete(column, row) for column in _columns(self))) if present else self
        values = _row(label)
        if not present:
            return _freeze(*(np.insert(c, row, value) for c, value in zip(_columns(self), values, strict=True)))
        columns = [column.copy() for column in _columns(self)]
        for column, value in zip(columns, values, strict=True):
            column[row] = value
        return _freeze(*columns)


def label_arrays(labels: Iterable[Label]) -> LabelArrays:
    """Labels in any order, each at its own time, as sorted columns."""
    ordered = sorted(labels, key=lambda label: label.t_us)
    table = np.array([_row(label) for label in ordered], np.float64).reshape(-1, 6)
    t_us = np.array(
        [label.t_us for label in ordered], np.int64
    )  # not through float64: large times keep every microsecond
    state, source = table[:, 4].astype(np.uint8), table[:, 5].astype(np.uint8)
    return _freeze(t_us, *(np.ascontiguousarray(table[:, column]) for column in (1, 2, 3)), state, source)


def arrays_of_columns(
    t_us: NDArray[np.int64],
    x_px: NDArray[np.float64],
    y_px: NDArray[np.float64],
    r_px: NDArray[np.float64],
    state: NDArray[np.uint8],
    source: NDArray[np.uint8],
) -> LabelArrays:
    """Columns that are sorted already; they become read-only.

    Args:
        t_us: (N,) times, ascending.
        x_px: (N,) columns of the centres; nan without a ball.
        y_px: (N,) rows.
        r_px: (N,) radii; nan where not known.
        state: (N,) indices of `STATES`.
        source: (N,) indices of `SOURCES`.
    """
    return _freeze(t_us, x_px, y_px, r_px, state, source)


def _row(label: Label) -> tuple[int, float, float, float, int, int]:
    x, y, r = (np.nan if value is None else value for value in (label.x_px, label.y_px, label.r_px))
    return label.t_us, x, y, r, STATES.index(label.state), SOURCES.index(label.provenance.source)


def _columns(arrays: LabelArrays) -> tuple[NDArray, ...]:
    return tuple(getattr(arrays, item.name) for item in fields(arrays))


def _freeze(*columns: NDArray) -> LabelArrays:
    for column in columns:
        if column.flags.owndata:
            column.flags.writeable = False
    return LabelArrays(*columns)


class LabelsByTime(Mapping[int, Label]):
    """The labels of a layer as they were after one edit; each is read when it is asked for."""

    def __init__(self, arrays: LabelArrays, read: Callable[[int], Label | None]) -> None:
        self._arrays, self._read = arrays, read
        self._known: dict[int, Label] = {}

    def __len__(self) -> int:
        return len(self._arrays)

    def __iter__(self) -> Iterator[int]:
        return iter(self._arrays.t_us.tolist())

    def __contains__(self, t_us: object) -> bool:
        if not isinstance(t_us, int | np.integer):
            return False
        times, row = self._arrays.t_us, int(np.searchsorted(self._arrays.t_us, t_us))
        return row < len(times) and bool(times[row] == t_us)

    def __getitem__(self, t_us: int) -> Label:
        label = self._known.get(t_us)
        if label is None:
            label = self._read(int(t_us)) if t_us in self else None
            if label is None:
                raise KeyError(t_us)
            self._known[t_us] = label
        return label
