"""The tour of one browser: opens by itself once, and never again when finished or skipped."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from app.client_session.tour.steps import TOURS
from app.state.client_state import MODES, ModeName
from app.web.pages import Json, Message

TOUR: Final = "tour"
"""Name of the stored hint: the tour was finished or skipped."""
BEGUN: Final = "tour begun"


class TourPage(Protocol):
    """The page's interface, with the browser's stored hints."""

    @property
    def is_new(self) -> bool: ...
    @property
    def has_link(self) -> bool: ...
    @property
    def seen(self) -> frozenset[str]: ...
    def note_seen(self, what: str) -> None: ...
    def listen(self, kind: str, listener: Callable[[Message], None]) -> None: ...
    def send(self, kind: str, values: Message) -> None: ...


class Tour:
    """The tour of one browser; used by the session's loop."""

    def __init__(self, page: TourPage) -> None:
        self._page = page
        seen = page.seen
        self._by_itself = not page.has_link and TOUR not in seen and (page.is_new or BEGUN in seen)
        self._done = {mode for mode in MODES if _of(mode) in seen}
        self._shown: ModeName | None = None
        self._mode: ModeName | None = None
        self._number = 0
        page.listen("tour", self._on_message)

    def tick(self, mode: ModeName) -> None:
        """Update for the chosen mode."""
        if mode == self._mode:
            return
        self._mode = mode
        if self._shown is not None:  # going on with the app finishes the tour
            self._note(self._shown)
        if self._by_itself and mode not in self._done:
            self._show(mode)
        elif self._shown is not None:
            self._show(None)

    def show(self) -> None:
        """Show the tour of a mode, even if it was seen before."""
        if self._mode is not None:
            self._show(self._mode)

    def _show(self, mode: ModeName | None) -> None:
        self._shown = mode
        self._number += 1
        steps: list[Json] = [] if mode is None else [[step.title, step.text, step.at] for step in TOURS[mode]]
        self._page.send("tour", {"number": self._number, "mode": mode or "", "steps": steps})
        if mode is not None and self._by_itself:
            self._page.note_seen(BEGUN)

    def _on_message(self, message: Message) -> None:
        if message.get("do") == "show":
            self.show()
            return
        if self._shown is None or message.get("number") != self._number:
            return
        shown, self._shown = self._shown, None
        if message.get("do") == "skip":
            self._by_itself = False
            self._page.note_seen(TOUR)
        elif message.get("do") == "done":
            self._note(shown)

    def _note(self, mode: ModeName) -> None:
        if mode not in self._done:
            self._done.add(mode)
            self._page.note_seen(_of(mode))


def _of(mode: ModeName) -> str:
    return f"tour of {mode}"
