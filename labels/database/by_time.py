"""The labels of a layer by their time, read one by one when they are asked for: nobody looks at 200,000 at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from labels.arrays import LabelArrays
from labels.model import Label


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
