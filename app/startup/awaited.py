"""A browser's wait for its first recording, such as a live rally in preparation."""

from __future__ import annotations

from collections.abc import Callable

from app.shared.library import Library
from app.startup.panel import PreparationPanel
from app.startup.steps import Preparation


class AwaitedRecording:
    """Owned by the browser's session, used by the loop only."""

    def __init__(
        self, library: Library, preparation: Preparation | None, add_card: Callable[[], PreparationPanel]
    ) -> None:
        """`preparation` is shown as a card until it is over; None if there is nothing to prepare."""
        self._library = library
        self._preparation = preparation
        self._card = None if preparation is None or preparation.over else add_card()
        self._name: str | None = None

    @property
    def waiting(self) -> bool:
        """Whether it is still waiting."""
        return self._name is not None

    def expect(self, name: str | None) -> None:
        """Wait for this recording; None cancels the wait, as another was chosen."""
        self._name = name

    def tick(self) -> str | None:
        """Show the progress; returns the recording's name once it exists."""
        if self._card is not None and self._preparation is not None:
            self._card.show(self._preparation.steps)
            if self._preparation.over:
                self._card = None
        if self._name is None or not self._library.has(self._name):
            return None
        arrived, self._name = self._name, None
        return arrived
