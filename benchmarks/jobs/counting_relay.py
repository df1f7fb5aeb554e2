"""A relay between a client and a scheduler on this machine that counts the bytes that pass."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress


class CountingRelay:
    """Where it listens, and how much has passed so far."""

    def __init__(self, target: tuple[str, int]) -> None:
        self._target = target
        self._door = socket.create_server(("127.0.0.1", 0))
        self._sockets: list[socket.socket] = []
        self._lock = threading.Lock()
        self.sent_bytes = 0
        """By the client."""
        self.received_bytes = 0
        self.address = f"tcp://127.0.0.1:{self._door.getsockname()[1]}"
        threading.Thread(target=self._admit, name="relay", daemon=True).start()

    def close(self) -> None:
        """Close all connections."""
        for each in (self._door, *self._sockets):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _admit(self) -> None:
        with suppress(OSError):  # closed
            while True:
                client, _ = self._door.accept()
                server = socket.create_connection(self._target)
                self._sockets += [client, server]
                for pair in ((client, server, True), (server, client, False)):
                    threading.Thread(target=self._pass_on, args=pair, name="relay", daemon=True).start()

    def _pass_on(self, source: socket.socket, target: socket.socket, sent: bool) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                with self._lock:
                    self.sent_bytes += len(data) if sent else 0
                    self.received_bytes += 0 if sent else len(data)
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)


@contextmanager
def counting_relay(address: str) -> Iterator[CountingRelay]:
    """A relay to `tcp://127.0.0.1:PORT`, until the block ends."""
    relay = CountingRelay(("127.0.0.1", int(address.rpartition(":")[2])))
    try:
        yield relay
    finally:
        relay.close()
