"""A simulation server that runs on a thread of the test, and has ended when the test has."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

from core.live.link.server import SimulationServer
from tests.waiting import PATIENCE_S

Server = TypeVar("Server", bound=SimulationServer)


@contextmanager
def serving(server: Server) -> Iterator[Server]:
    """Run a server until the block ends; its ports are closed then."""
    ended = threading.Event()
    thread = threading.Thread(target=server.run, args=(ended.is_set,))
    thread.start()
    try:
        yield server
    finally:
        ended.set()
        thread.join(PATIENCE_S)
        assert not thread.is_alive(), "the simulation server does not end"
