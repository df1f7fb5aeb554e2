"""What the door costs: viser's server behind it beside viser's server without, in one process, turn by turn."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import closing
from typing import Any, Final
from urllib.request import urlopen

import numpy as np
import viser
from viser._messages import GuiUpdateMessage
from websockets.sync.client import ClientConnection

from app.web.access_policy import Admission
from app.web.gateway import Gateway
from benchmarks.app.bare_browser import CAMERA, connect_to, encoded, messages_in

TURNS: Final = 60
PATIENCE_S: Final = 60.0
UPDATES: Final = 10
"""A turn: a page, a connection, and so many updates that go there and back."""
KINDS: Final = ("page", "connection to first message", "update, there and back")


def measure_door(progress: Callable[[float], None] = lambda share: None, turns: int = TURNS) -> list[dict[str, object]]:
    """Rows of each kind of exchange: its median and 99th percentile in ms without the door and behind it.

    The order of the two changes from turn to turn.
    """
    plain = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    behind = Gateway("127.0.0.1", 0, Admission()).server
    try:
        servers = {"plain": _Echo(plain), "door": _Echo(behind)}
        taken: dict[tuple[str, str], list[float]] = {(name, kind): [] for name in servers for kind in KINDS}
        for turn in range(-2, turns):  # the first ones load code and are not counted
            progress(max(turn, 0) / turns)
            for name in sorted(servers, reverse=turn % 2 == 0):
                for kind, seconds in servers[name].take_turn():
                    if turn >= 0:
                        taken[name, kind].append(1e3 * seconds)
    finally:
        plain.stop()
        behind.stop()
    return [_row(kind, taken["plain", kind], taken["door", kind]) for kind in KINDS]


class _Echo:
    """A server with a text that it shows again, and a client of it."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._port = server.get_port()
        self._said, self._count = server.gui.add_text("said", ""), 0
        shown = server.gui.add_text("shown", "")

        @self._said.on_update
        async def _(_: viser.GuiEvent) -> None:
            shown.value = self._said.value

    def take_turn(self) -> list[tuple[str, float]]:
        """(kind, seconds) of each exchange."""
        page_s = _seconds(lambda: urlopen(f"http://127.0.0.1:{self._port}/", timeout=PATIENCE_S).read())
        began_s = time.perf_counter()
        with closing(connect_to(self._port)) as socket:
            socket.send(encoded(CAMERA))
            socket.recv(PATIENCE_S)
            first_s = time.perf_counter() - began_s
            updates = [_seconds(lambda: self._there_and_back(socket)) for _ in range(UPDATES)]
        return [("page", page_s), (KINDS[1], first_s), *((KINDS[2], seconds) for seconds in updates)]

    def _there_and_back(self, socket: ClientConnection) -> None:
        self._count += 1
        text = f"text {self._count}"
        socket.send(encoded(GuiUpdateMessage(self._said._impl.uuid, {"value": text})))
        while not any(_shows(message, text) for message in messages_in(socket.recv(PATIENCE_S))):
            pass


def _shows(message: Mapping[str, Any], text: str) -> bool:
    return message["type"] == "GuiUpdateMessage" and message["updates"].get("value") == text


def _seconds(act: Callable[[], object]) -> float:
    began_s = time.perf_counter()
    act()
    return time.perf_counter() - began_s


def _row(kind: str, plain_ms: list[float], door_ms: list[float]) -> dict[str, object]:
    plain, door = np.array(plain_ms), np.array(door_ms)
    return {
        "exchange": kind,
        "plain_p50_ms": float(np.median(plain)),
        "plain_p99_ms": float(np.percentile(plain, 99)),
        "door_p50_ms": float(np.median(door)),
        "door_p99_ms": float(np.percentile(door, 99)),
        "ratio_p50": float(np.median(door) / np.median(plain)),
        "count": len(plain),
    }
