"""The pages that are open in browsers, each with a second websocket beside viser's for small messages of ours."""

from __future__ import annotations

import asyncio
import json
import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.protocol import State

from app.web.uploads import Uploads
from core.text import parse_json

logger = logging.getLogger(__name__)
MAX_MESSAGE_BYTES: Final = 65_536
Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]
Message = Mapping[str, Json]


@dataclass(frozen=True, slots=True)
class PageConnection:
    """What a browser said when its page connected. None of it is trusted: names to look things up by."""

    page: str = ""
    """Identifier of this load of the page; "" where it has no script of ours."""
    browser: str = ""
    """Identifier of the browser, from its cookie; "" for a client that keeps none."""
    link: str = ""
    """What stood behind the # of its address."""


@dataclass(eq=False, slots=True)
class _Page:
    latest: dict[str, Message] = field(default_factory=dict)
    """What the page is to know, by type: sent anew when its websocket comes after the message."""
    unsent: dict[str, Message] = field(default_factory=dict)
    connection: ServerConnection | None = None
    loop: asyncio.AbstractEventLoop | None = None
    news: asyncio.Event | None = None
    listen: Callable[[Message], None] | None = None


class Pages:
    """Thread-safe. A message replaces an earlier one of its type that has not been sent yet."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._pages: dict[str, _Page] = {}
        self.uploads = Uploads()
        """Files that they send."""

    def open(self, page: str, listen: Callable[[Message], None]) -> None:
        """A session is there for this page; `listen` gets the page's messages in the server's event loop.

        Where viser's own websocket broke and came anew, the page's other one goes on, with the new session.
        """
        with self._lock:
            known = self._pages.setdefault(page, _Page())
            known.listen = listen
            known.latest.clear()
            known.unsent.clear()

    def close(self, page: str, listen: Callable[[Message], None]) -> None:
        """The session that listened is gone: so is the page, and hears it by the end of its websocket.

        Nothing happens if another session has taken over.
        """
        with self._lock:
            known = self._pages.get(page)
            if known is None or known.listen != listen:
                return
            gone = self._pages.pop(page)
        self.uploads.close(page)
        if gone.loop is not None and gone.connection is not None:
            _in_loop(gone.loop, gone.connection.close())

    def send(self, page: str, type_: str, values: Message) -> None:
        """Let the page know; nothing happens if there is none."""
        message = {"type": type_, **values}
        with self._lock:
            known = self._pages.get(page)
            if known is None:
                return
            known.latest[type_] = known.unsent[type_] = message
            loop, news = known.loop, known.news
        if loop is not None and news is not None:
            try:
                loop.call_soon_threadsafe(news.set)
            except RuntimeError:  # the server has ended
                logger.debug("a message for a page after the end")

    async def serve(self, page: str, connection: ServerConnection) -> None:
        """Carry the messages of one page until its websocket ends."""
        known = await self._await_session(page, connection)
        if known is None:
            return
        with self._lock:
            known.connection, known.loop, known.news = connection, asyncio.get_running_loop(), asyncio.Event()
            known.unsent = dict(known.latest)
            known.news.set()
            news = known.news
        sending = asyncio.create_task(self._send_news(known, connection, news))
        try:
            async for text in connection:
                self._hear(known, text)
        except ConnectionClosed:
            pass
        finally:
            sending.cancel()

    async def _await_session(self, page: str, connection: ServerConnection) -> _Page | None:
        """Its session begins with the first picture that viser draws, which may take long; None if the page leaves."""
        while connection.state is State.OPEN:
            with self._lock:
                known = self._pages.get(page)
            if known is not None:
                return known
            await asyncio.sleep(0.05)
        return None

    async def _send_news(self, known: _Page, connection: ServerConnection, news: asyncio.Event) -> None:
        try:
            while True:
                await news.wait()
                news.clear()
                with self._lock:
                    unsent, known.unsent = known.unsent, {}
                for message in unsent.values():
                    await connection.send(json.dumps(message))
        except ConnectionClosed:
            pass

    def _hear(self, known: _Page, text: str | bytes) -> None:
        if isinstance(text, bytes) or len(text) > MAX_MESSAGE_BYTES or known.listen is None:
            return
        try:
            message = parse_json(text)
        except (ValueError, RecursionError):
            return
        if isinstance(message, dict) and isinstance(message.get("type"), str):
            known.listen(message)


def _in_loop(loop: asyncio.AbstractEventLoop, coroutine) -> None:
    try:
        asyncio.run_coroutine_threadsafe(coroutine, loop)
    except RuntimeError:
        coroutine.close()
