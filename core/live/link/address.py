"""Addresses of the simulation link."""

from __future__ import annotations

from core.errors import LinkError


def split_address(address: str, *, lowest: int = 0) -> tuple[str, int]:
    """Host and port of `tcp://HOST:PORT`, where the next port is one, too.

    Raises:
        LinkError: if it is no such address, or its port is below `lowest`.
    """
    host, _, port = address.removeprefix("tcp://").rpartition(":")
    digits = port.isascii() and port.isdigit() and len(port) < 6
    if not address.startswith("tcp://") or not host or not digits or not lowest <= int(port) <= 65534:
        raise LinkError("not an address", expected="tcp://HOST:PORT", got=repr(address[:100]))
    return host, int(port)
