"""Listeners of one live source."""

from __future__ import annotations

from core.live.link import messages as m
from core.live.link.live_source import LinkListener


class LinkListeners:
    """What it hears, all of them hear, in the order in which they came.

    The source keeps it under a lock of its own: nobody comes or goes while something is told.
    """

    def __init__(self) -> None:
        self._all: list[LinkListener] = []

    def __bool__(self) -> bool:
        """Whether there is a listener."""
        return bool(self._all)

    def add(self, listener: LinkListener, welcome: m.Reply) -> None:
        """Add a listener; it gets the present session at once."""
        listener.on_session(welcome)
        self._all.append(listener)

    def remove(self, listener: LinkListener) -> None:
        """Remove a listener, if it is there."""
        if listener in self._all:
            self._all.remove(listener)

    def on_session(self, welcome: m.Reply) -> None:
        """Pass on a new session."""
        for listener in self._all:
            listener.on_session(welcome)

    def on_events(self, batch: m.EventBatch) -> None:
        """Pass on events."""
        for listener in self._all:
            listener.on_events(batch)

    def on_state(self, state: m.WorldState) -> None:
        """Pass on a state; it may end a block."""
        for listener in self._all:
            listener.on_state(state)

    def on_notice(self, notice: m.Notice) -> None:
        """Pass on a notice."""
        for listener in self._all:
            listener.on_notice(notice)
