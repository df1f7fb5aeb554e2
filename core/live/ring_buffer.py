"""Columns that grow at one end and are forgotten at the other, and are read whole, often, without being copied."""

from __future__ import annotations

from bisect import bisect_left
from typing import Final

import numpy as np
from numpy.typing import NDArray

MIN_ROWS: Final = 1024
Columns = tuple[NDArray, ...]


class RingBuffer:
    """Pieces of rows, each with a number; the columns of all pieces in the order of their numbers.

    What was read stays as it was: rows are written behind those that are there, or all of them anew somewhere else.
    Not safe to use from several threads.
    """

    def __init__(self) -> None:
        self._numbers: list[int] = []
        self._ends: list[int] = []
        """Row behind each piece."""
        self._first = 0
        """The first row that is remembered."""
        self._columns: Columns = ()

    @property
    def columns(self) -> Columns | None:
        """Each with the rows of all pieces; None where there is no piece."""
        if not self._numbers:
            return None
        return tuple(column[self._first : self._ends[-1]] for column in self._columns)

    def put(self, number: int, piece: Columns) -> None:
        """One piece more; one with the same number is replaced."""
        if self._numbers and number <= self._numbers[-1]:
            self._put_between(number, piece)
            return
        end = self._ends[-1] if self._ends else self._first
        rows = len(piece[0])
        if not self._columns or end + rows > len(self._columns[0]):
            self._move(rows, piece)
            end = self._ends[-1] if self._ends else self._first
        for column, new in zip(self._columns, piece, strict=True):
            column[end : end + rows] = new
        self._numbers.append(number)
        self._ends.append(end + rows)

    def forget_before(self, number: int) -> None:
        """Of older pieces nothing is told any more."""
        count = bisect_left(self._numbers, number)
        if count:
            self._first = self._ends[count - 1]
            del self._numbers[:count], self._ends[:count]

    def _move(self, more: int, like: Columns) -> None:
        """Room for at least as much again, elsewhere."""
        kept = self.columns or tuple(column[:0] for column in like)
        rows = len(kept[0])
        room = max(MIN_ROWS, 2 * (rows + more))
        moved = tuple(np.empty((room, *column.shape[1:]), column.dtype) for column in kept)
        for column, old in zip(moved, kept, strict=True):
            column[:rows] = old
        self._ends = [end - self._first for end in self._ends]
        self._columns, self._first = moved, 0

    def _put_between(self, number: int, piece: Columns) -> None:
        """What came late, or again."""
        pieces: dict[int, Columns] = {number: piece}
        starts = [self._first, *self._ends[:-1]]
        for known, start, end in zip(self._numbers, starts, self._ends, strict=True):
            pieces.setdefault(known, tuple(column[start:end] for column in self._columns))
        self.__init__()
        for known in sorted(pieces):
            self.put(known, pieces[known])
