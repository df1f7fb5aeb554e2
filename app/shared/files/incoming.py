"""Folders beside the recordings for what is on its way in: sent by a browser, or being decoded. Nobody lists them."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

from app.shared.workspace import Workspace
from core.files import put_in_place, sync

PREFIX: Final = ".incoming-"
ABANDONED_S: Final = 3600.0
"""What nobody has written to for so long was left by an app that was killed."""


def incoming_folder(workspace: Workspace) -> Path:
    """A new, empty folder of its own, on the disk that the recordings are on."""
    return Path(tempfile.mkdtemp(prefix=PREFIX, dir=workspace.recordings))


def clear_abandoned(workspace: Workspace, *, older_than_s: float = ABANDONED_S) -> None:
    """Take away what an app that was killed had not finished."""
    for folder in workspace.recordings.glob(f"{PREFIX}*"):
        with suppress(OSError):
            changed_s = max(path.stat().st_mtime for path in (folder, *folder.iterdir()))
            if time.time() - changed_s > older_than_s:
                shutil.rmtree(folder, ignore_errors=True)


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
