"""All who listen to one live source."""

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
        """Whether anybody listens."""
        return bool(self._all)

    def add(self, listener: LinkListener, welcome: m.Reply) -> None:
        """From now on; it hears of the present session at once."""
        listener.on_session(welcome)
        self._all.append(listener)

    def remove(self, listener: LinkListener) -> None:
        """It hears nothing after this; none that is not there is missed."""
        if listener in self._all:
            self._all.remove(listener)

    def on_session(self, welcome: m.Reply) -> None:
        """A session begins."""
        for listener in self._all:
            listener.on_session(welcome)

    def on_events(self, batch: m.EventBatch) -> None:
        """What a camera saw."""
        for listener in self._all:
            listener.on_events(batch)

    def on_state(self, state: m.WorldState) -> None:
        """Where everything is; it may end a block."""
        for listener in self._all:
            listener.on_state(state)

    def on_notice(self, notice: m.Notice) -> None:
        """Something happened."""
        for listener in self._all:
            listener.on_notice(notice)
