"""Ports for a server that is ended and started again: in between nobody else may get them."""

import random
import socket
from pathlib import Path
from typing import Final

GIVEN: Final = Path("/proc/sys/net/ipv4/ip_local_port_range")
"""First and last port that the system gives to whoever asks for any, connections among them."""
BELOW: Final = 8000
"""How many ports below those are looked at."""


def lasting_address() -> str:
    """`tcp://127.0.0.1:PORT` of a free port, the next one free too, which the system gives to nobody by itself.

    A port that the system chose may be another program's as soon as its server has ended: of another test, or of a
    client's own connection, which tries the address again and again.
    """
    first = int(GIVEN.read_text().split()[0]) if GIVEN.is_file() else 32768
    ports = list(range(max(1024, first - BELOW), first - 1))
    random.shuffle(ports)  # not from a seed: tests that run at the same time have to differ
    return f"tcp://127.0.0.1:{next(port for port in ports if _is_free(port) and _is_free(port + 1))}"


def _is_free(port: int) -> bool:
    with socket.socket() as one:
        try:
            one.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
