"""Folders beside the recordings for what is on its way in: sent by a browser, or being decoded. Nobody lists them."""

from __future__ import annotations

from pathlib import Path

from app.shared.workspace import Workspace
from core.files import begin_unfinished


def incoming_folder(workspace: Workspace) -> Path:
    """A new, empty folder of its own, on the disk that the recordings are on; `end_unfinished` takes it away."""
    return begin_unfinished(workspace.recordings)
