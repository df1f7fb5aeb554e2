"""Keys that came before what they judge: kept, in their order, until it is there."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable


class HeldKeys:
    """The keys that one browser holds down. Methods are called by the loop.

    `waits(name)`: this act cannot be carried out yet. `place()`: what it would be about; when that becomes something
    else while an act waits, the person went elsewhere, and what was held is forgotten.
    """

    def __init__(
        self, carry_out: Callable[[str], None], waits: Callable[[str], bool], place: Callable[[], object]
    ) -> None:
        self._carry_out = carry_out
        self._waits = waits
        self._place = place
        self._held: deque[str] = deque()
        self._held_at: object = None

    def __len__(self) -> int:
        return len(self._held)

    @property
    def ready(self) -> bool:
        """Something is held that need not be held any longer."""
        return bool(self._held) and (self._place() != self._held_at or not self._waits(self._held[0]))

    def press(self, name: str) -> None:
        """Carry out an act after all that are held. Escape forgets those; what waits last waits once."""
        if self._held and name == "escape":
            self._held.clear()
        elif not (self._held and self._held[-1] == name and self._waits(name)):
            self._held.append(name)
            if len(self._held) == 1:
                self._held_at = self._place()
                self.go_on()

    def go_on(self) -> None:
        """Carry out what is held, up to an act that must wait."""
        if self._held and self._place() != self._held_at:
            self._held.clear()
        while self._held and not self._waits(self._held[0]):
            self._carry_out(self._held.popleft())
            self._held_at = self._place()

    def forget(self) -> None:
        """What was pressed is not to be done any more."""
        self._held.clear()
