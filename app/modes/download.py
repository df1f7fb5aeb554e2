"""A file from the folder of exports to one browser."""

from __future__ import annotations

from typing import Final

from app.modes.mode import ModeHost
from core.errors import CommandError

LARGEST_DOWNLOAD: Final = 1_000_000_000
"""Bytes; a download goes through this process's memory."""


def download_export(host: ModeHost, name: str) -> None:
    """Send it; reading and sending go on in the pool.

    Raises:
        CommandError: if there is no such export, or it is too large.
    """
    path = host.services.exporter.path_of(name)
    if path.stat().st_size > LARGEST_DOWNLOAD:
        raise CommandError("too large to download through the browser", got=name, remedy=f"it is here: {path}")
    send = host.client.send_file_download
    host.pool.submit(lambda: send(path.name, path.read_bytes(), save_immediately=True))
