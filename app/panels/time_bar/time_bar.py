"""The bar of one browser: tells the page what to draw, and takes what it asks for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from app.panels.time_bar.messages import bar_message, command_of, tracks_message
from app.panels.time_bar.tracks import Tracks
from app.state.client_state import ClientState
from app.state.commands import Command
from app.web.pages import Message

SHOW_EVERY_S: Final = 1 / 12
"""While it plays the page moves the cursor by itself, and is put right this often."""


class BarPage(Protocol):
    """The page, as the bar knows it."""

    def listen(self, kind: str, listener: Callable[[Message], None]) -> None: ...
    def send(self, kind: str, values: Message) -> None: ...


class TimeBar:
    """All methods are called in the loop."""

    def __init__(self, page: BarPage, send: Callable[[Command], None]) -> None:
        self._page = page
        self._send = send
        self._shown: Message = {}
        self._shown_s = 0.0
        page.listen("bar", self._asked)

    def show(self, state: ClientState, now_us: int, wall_s: float, *, visible: bool, keys: bool) -> None:
        """Follow the state."""
        if wall_s - self._shown_s < SHOW_EVERY_S:
            return
        message = bar_message(state, now_us, visible=visible, keys=keys)
        if message != self._shown:
            self._shown, self._shown_s = message, wall_s
            self._page.send("bar", message)

    def show_tracks(self, tracks: Tracks) -> None:
        """Draw these lines."""
        self._page.send("tracks", tracks_message(tracks))

    def _asked(self, message: Message) -> None:
        if (command := command_of(message)) is not None:
            self._send(command)
