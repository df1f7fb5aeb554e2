"""Check of the address that the app is to listen on."""

from __future__ import annotations

import socket

from core.errors import CommandError


def check_address(host: str, port: int) -> None:
    """Try to listen for a moment; port 0 stands for any free one.

    Raises:
        CommandError: if the address cannot be used.
    """
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except (OSError, OverflowError) as error:
        raise port_taken(host, port, str(error)) from error


def port_taken(host: str, port: int, reason: str) -> CommandError:
    """Error message for an address that cannot be listened on."""
    remedy = "it may run there already: open it in a browser, or choose another with --port or --host"
    return CommandError(f"cannot listen on {host}:{port}", got=reason, remedy=remedy)
