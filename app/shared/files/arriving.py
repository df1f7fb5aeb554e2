"""A file becomes a recording that the library can open: as it is, or decoded once."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import h5py

from app.shared.files.incoming import incoming_folder
from app.shared.library import Library
from app.shared.workspace import Workspace, slug_from
from core.errors import CommandError, RecordingError
from core.files import end_unfinished, put_beside
from core.recordings import import_recording, open_recording
from core.recordings.identity import source_uuid
from core.recordings.log.growing import is_growing
from core.recordings.opening import is_recording
from core.recordings.sources import open_sources

MIN_FREE_BYTES: Final = 200_000_000
"""So much of the disk stays free: packed files can be very much larger than they look."""
LOOK_EVERY_S: Final = 0.5
UNNAMED: Final = "recording"


def bring_in(
    path: Path,
    library: Library,
    workspace: Workspace,
    *,
    received: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> str | None:
    """Name in the library of the recording that a file is or has become; None if `cancelled` said so.

    A file that was `received` from a browser moves into the workspace if it is a recording already. What was brought
    in before is not brought in again. Nothing is ever overwritten, and nothing is left of what fails.

    Raises:
        RecordingError: if the file cannot be read, or the disk has no room for the result.
    """
    own = path.parent == workspace.recordings
    if is_growing(path) or is_recording(path):
        if own:
            return path.stem
        return _keep_recording(path, workspace) if received else library.add_external(path)
    wanted = path.stem if own else _slug(path.stem)
    uuid = source_uuid([path], [source.name for source in open_sources(path)], "None", 0)  # as importing it makes it
    known = _already_there(workspace, wanted, uuid)
    if known is not None:
        return known
    folder = incoming_folder(workspace)
    try:
        decoded = folder / "decoded.h5"
        watched = _watching_the_disk(folder, progress)
        if import_recording([path], decoded, progress=watched, cancelled=cancelled) is None:
            return None
        return _place(decoded, workspace, wanted, uuid)
    finally:
        end_unfinished(folder)


def _keep_recording(path: Path, workspace: Workspace) -> str:
    with open_recording(path) as recording:  # one that was never closed is finished by this
        uuid = recording.uuid
    return _place(path, workspace, _slug(path.stem), uuid, size_bytes=path.stat().st_size)


def _place(source: Path, workspace: Workspace, wanted: str, uuid: str, *, size_bytes: int | None = None) -> str:
    """Put a recording under the first free name that begins as wanted, or take the same one that is there."""
    while True:
        known = _already_there(workspace, wanted, uuid, size_bytes=size_bytes)
        if known is not None:
            return known
        name = next(name for name in _names(wanted) if not _path(workspace, name).exists())
        try:
            put_beside(source, _path(workspace, name))
        except FileExistsError:  # another was quicker
            continue
        return name


def _already_there(workspace: Workspace, wanted: str, uuid: str, *, size_bytes: int | None = None) -> str | None:
    for name in _names(wanted):
        path = _path(workspace, name)
        if not path.exists():
            return None
        if _uuid_of(path) == uuid and size_bytes in (None, path.stat().st_size):
            return name
    return None


def _names(wanted: str):
    yield wanted
    yield from (f"{wanted}-{number}" for number in range(2, 100_000))


def _path(workspace: Workspace, name: str) -> Path:
    return workspace.recordings / f"{name}.h5"


def _slug(stem: str) -> str:
    try:
        return slug_from(stem)[:56].rstrip("-_")
    except CommandError:
        return UNNAMED


def _uuid_of(path: Path) -> str | None:
    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs.get("uuid"))
    except OSError:
        return None


def _watching_the_disk(folder: Path, progress: Callable[[float], None]) -> Callable[[float], None]:
    looked_s = 0.0

    def tell(share: float) -> None:
        nonlocal looked_s
        progress(share)
        if time.monotonic() - looked_s < LOOK_EVERY_S:
            return
        looked_s = time.monotonic()
        free = shutil.disk_usage(folder).free
        if free < MIN_FREE_BYTES:
            raise RecordingError(
                "the disk is too full for this recording",
                expected=f"{MIN_FREE_BYTES / 1e6:.0f} MB free",
                got=f"{free / 1e6:.0f} MB",
                remedy="free some space and open the file again",
            )

    return tell
