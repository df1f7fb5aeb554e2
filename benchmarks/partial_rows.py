"""What a bench has measured so far, told row by row: some take many minutes to the last."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Protocol, runtime_checkable


@runtime_checkable
class RowListener(Protocol):
    """Progress that also wants to hear of rows."""

    def __call__(self, share: float) -> None:
        """So much is done."""

    def row(self, row: Mapping[str, object]) -> None:
        """A row is known."""


def report_rows_to(progress: Callable[[float], None], rows: Iterable[Mapping[str, object]], share: float) -> None:
    """Tell whoever follows the progress of rows that were just made, and the share 0 to 1 that is done with them."""
    if isinstance(progress, RowListener):
        for row in rows:
            progress.row(row)
    progress(share)


def within(progress: Callable[[float], None], first: float, last: float) -> Callable[[float], None]:
    """Progress of a part, 0 to 1, as progress of the whole from `first` to `last`."""
    return lambda share: progress(first + share * (last - first))
