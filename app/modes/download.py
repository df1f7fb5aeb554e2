"""What became of an export in words, and a file from the folder of exports to one browser."""

from __future__ import annotations

from typing import Final

from app import theme
from app.export.exporter import ExportState
from app.formatting.file_text import html_text
from app.formatting.percent import percent
from app.modes.mode import ModeHost
from core.errors import CommandError

LARGEST_DOWNLOAD: Final = 1_000_000_000
"""Bytes; a download goes through this process's memory."""
STYLE: Final = "padding:2px 1em;font-size:13px;line-height:1.5"


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


def state_html(state: ExportState | None) -> str:
    """One line about the latest export."""
    if state is None:
        return f"<div style='{STYLE}'>Files are made in the folder <b>exports</b> of the workspace.</div>"
    if state.running:
        left = "" if state.left_s is None else f", about {max(1, round(state.left_s))} s left"
        text = f"{html_text(state.name)}: {percent(state.share)}{left}"
        return f"<div style='{STYLE}'>{text}</div>"
    colour = theme.BAD if state.failed else theme.MUTED if state.message == "cancelled" else theme.GOOD
    text = f"{html_text(state.message)} ({state.seconds:.0f} s)"
    return f"<div style='{STYLE};color:{colour}'>{text}</div>"
