"""Folders beside the recordings for what is on its way in: sent by a browser, or being decoded. Nobody lists them."""

from __future__ import annotations

import os
from pathlib import Path

from app.shared.workspace import Workspace
from core.files import begin_unfinished, put_in_place, sync


def incoming_folder(workspace: Workspace) -> Path:
    """A new, empty folder of its own, on the disk that the recordings are on; `end_unfinished` takes it away."""
    return begin_unfinished(workspace.recordings)


def put_beside(source: Path, target: Path) -> None:
    """Give a file its final name on the same disk, so that a power cut cannot undo it.

    Raises:
        FileExistsError: if there is a file of that name; it stays as it is.
    """
    sync(source)
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        target.open("xb").close()
        put_in_place(source, target, durable=True)
        return
    sync(target.parent)
    source.unlink()
