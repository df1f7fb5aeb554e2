"""Files that browsers send, over a websocket of their own: in pieces, each acknowledged, never whole in memory.

viser's server reads no bodies of HTTP requests, so a file cannot be posted. The page says name, size and purpose as
JSON, gets `{"ready": true}`, sends pieces, and gets `{"got": BYTES}` for each; what is refused gets `{"refused": WHY}`.
The name is only a hint: the file lies in a new folder under a name that is made here.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import re
import shutil
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Literal

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from app.viser_parts import limit_messages
from core.files import end_unfinished
from core.text import parse_json

logger = logging.getLogger(__name__)
MAX_UPLOAD_BYTES: Final = 200_000_000
MAX_PIECE_BYTES: Final = 1 << 20
MAX_AT_ONCE: Final = 4
PIECE_WITHIN_S: Final = 30.0
WHOLE_WITHIN_S: Final = 1800.0
KEPT_FREE_BYTES: Final = 200_000_000
"""So much of the disk is left free."""
LONGEST_STEM: Final = 56
_NO_NAME: Final = "recording"
Purpose = Literal["recording", "labels"]
"""What a file is for."""
Taker = Callable[[Path], None]
MAX_LABELS_BYTES: Final = 50_000_000
REMEDIES: Final[Mapping[str, str]] = {
    "recording": "Put it into the folder of recordings instead, or use `rallyscope import`.",
    "labels": "Put it into the folder labels-to-import of the workspace instead, or use `rallyscope labels import`.",
}
"""What to do with a file that is too large, by purpose."""


class RefusedUpload(Exception):  # noqa: N818 (it is an answer to the page, and no failure of ours)
    """Why a file is not taken, in a line for the person."""


class Uploads:
    """Receives files for the pages that are open. Thread-safe."""

    def __init__(self, *, most_bytes: int = MAX_UPLOAD_BYTES, piece_within_s: float = PIECE_WITHIN_S) -> None:
        self._most_bytes = {"recording": most_bytes, "labels": min(most_bytes, MAX_LABELS_BYTES)}
        self._piece_within_s = piece_within_s
        self._lock = threading.Lock()
        self._takers: dict[str, dict[str, Taker]] = {}
        """Page -> purpose -> who takes its files."""
        self._sending: set[str] = set()
        self.new_folder: Callable[[], Path] | None = None
        """Makes an empty folder for a file; without it none is taken."""

    def open(self, page: str, take: Taker, purpose: Purpose = "recording") -> None:
        """From now on this page may send files for a purpose.

        `take` gets each, with the folder that it lies alone in, as its own.
        """
        with self._lock:
            self._takers.setdefault(page, {})[purpose] = take

    def close(self, page: str) -> None:
        """The page was closed."""
        with self._lock:
            self._takers.pop(page, None)

    async def serve(self, page: str, browser: str, connection: ServerConnection) -> None:
        """Receive one file."""
        limit_messages(connection, MAX_PIECE_BYTES)
        sender = browser or page
        try:
            with self._lock:
                self._admit(page, sender)
                self._sending.add(sender)
            try:
                async with asyncio.timeout(WHOLE_WITHIN_S):
                    await self._receive(page, connection)
            finally:
                with self._lock:
                    self._sending.discard(sender)
        except RefusedUpload as refused:
            await _say(connection, refused=str(refused))
        except TimeoutError:
            await _say(connection, refused="The upload timed out; send the file again.")
        except OSError as error:
            logger.warning("a file that a browser sent could not be written: %s", error)
            await _say(connection, refused="The server could not write it to its disk.")
        except ConnectionClosed:  # the page left, or the person cancelled
            pass

    def _admit(self, page: str, sender: str) -> None:
        if page not in self._takers or self.new_folder is None:
            raise RefusedUpload("Only an open page of the app can send files.")
        if sender in self._sending:
            raise RefusedUpload("This browser is sending a file already; one at a time.")
        if len(self._sending) >= MAX_AT_ONCE:
            raise RefusedUpload("Other browsers are sending files; try again in a moment.")

    async def _receive(self, page: str, connection: ServerConnection) -> None:
        name, size_bytes, purpose = self._announced(await self._next(connection))
        with self._lock:
            if purpose not in self._takers.get(page, {}):
                raise RefusedUpload("This page takes no such file.")
        folder = await asyncio.to_thread(self._make_folder, size_bytes)
        path = folder / name
        try:
            # x: never over a file that is there.
            with path.open("xb") as file:
                await _say(connection, ready=True)
                got_bytes = 0
                while got_bytes < size_bytes:
                    piece = await self._next(connection)
                    if isinstance(piece, str) or not piece:
                        raise RefusedUpload("The upload was invalid; reload the page.")
                    got_bytes += len(piece)
                    if got_bytes > size_bytes:
                        raise RefusedUpload("More data came than announced; the file may have changed meanwhile.")
                    await asyncio.to_thread(file.write, piece)
                    await _say(connection, got=got_bytes)
            with self._lock:
                # Again: the page may have gone while it sent.
                take = self._takers.get(page, {}).get(purpose)
            if take is None:
                raise RefusedUpload("The page was closed.")
            take(path)
        except BaseException:
            end_unfinished(folder)
            raise

    async def _next(self, connection: ServerConnection) -> str | bytes:
        return await asyncio.wait_for(connection.recv(), self._piece_within_s)

    def _announced(self, text: str | bytes) -> tuple[str, int, str]:
        """Name, size and purpose of the file that is to come."""
        try:
            request = parse_json(text) if isinstance(text, str) else None
        except (ValueError, RecursionError):
            request = None
        values = request if isinstance(request, dict) else {}
        name, size, purpose = values.get("name"), values.get("size"), values.get("purpose", "recording")
        known = isinstance(purpose, str) and purpose in self._most_bytes
        if not isinstance(name, str) or not isinstance(size, int) or isinstance(size, bool) or size < 0 or not known:
            raise RefusedUpload("The upload was invalid; reload the page.")
        if size == 0:
            raise RefusedUpload("The file is empty.")
        most_bytes = self._most_bytes[purpose]
        if size > most_bytes:
            raise RefusedUpload(
                f"It has {size / 1e6:,.0f} MB, and a browser may send up to {most_bytes / 1e6:,.0f} MB. "
                + REMEDIES[purpose]
            )
        return safe_name(name), size, purpose

    def _make_folder(self, size_bytes: int) -> Path:
        assert self.new_folder is not None
        folder = self.new_folder()
        if shutil.disk_usage(folder).free < size_bytes + KEPT_FREE_BYTES:
            end_unfinished(folder)
            raise RefusedUpload("The server's disk is too full for it.")
        return folder


def safe_name(name: str) -> str:
    """A plain file name that resembles what a browser calls its file: no folders, only letters that mean nothing."""
    last = re.split(r"[/\\]", name[-400:])[-1]
    stem, dot, suffix = last.rpartition(".")
    if not dot or not re.fullmatch(r"[A-Za-z0-9]{1,8}", suffix):
        stem, suffix = last, ""
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-_")[:LONGEST_STEM].rstrip("-_") or _NO_NAME
    return f"{stem}.{suffix.lower()}" if suffix else stem


async def _say(connection: ServerConnection, **values: object) -> None:
    with contextlib.suppress(ConnectionClosed):
        await connection.send(json.dumps(values))
