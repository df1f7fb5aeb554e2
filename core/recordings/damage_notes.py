"""What a reader of a damaged file went on without, for a person to know."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from core.errors import RallyscopeError


class DamageNotes:
    """Notes in the order in which they were made, each once; any thread may add one."""

    def __init__(self) -> None:
        self._notes: dict[str, None] = {}

    @property
    def texts(self) -> tuple[str, ...]:
        """All so far, one line each."""
        return tuple(self._notes.copy())

    def add(self, text: str) -> None:
        """Say something about the file."""
        self._notes.setdefault(" ".join(text.split()))

    @contextmanager
    def left_out(self, what: str) -> Iterator[None]:
        """Go on without what cannot be read in a block, with a note that says why."""
        try:
            yield
        except RallyscopeError as error:
            self.add(f"{what[0].upper()}{what[1:]}: left out, {error}.")
