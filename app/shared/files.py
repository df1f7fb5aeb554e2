"""Files outside the workspace: listing, and importing them as recordings."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Final

import h5py

from app.shared.library import Library
from app.shared.workspace import Workspace, slug_from
from core.errors import CommandError, RecordingError
from core.events import SensorSize
from core.files import begin_unfinished, end_unfinished, numbered, put_beside
from core.recordings import ImportOrder, check_import, import_recording, open_recording
from core.recordings.import_facts import ImportFacts
from core.recordings.log.growing import is_growing
from core.recordings.opening import is_recording
from core.recordings.sources import open_sources
from core.recordings.sources.kinds import kind_of
from core.recordings.sources.source import ImportOptions


def incoming_folder(workspace: Workspace) -> Path:
    """New empty folder on the recordings' disk; `end_unfinished` removes it."""
    return begin_unfinished(workspace.recordings)


MIN_FREE_BYTES: Final = 200_000_000
"""Free disk space that is kept: compressed files may expand a lot."""
LOOK_EVERY_S: Final = 0.5
UNNAMED: Final = "recording"
LONGEST_LOOK_S: Final = 2.0
"""So long the events of a file are read before a person is asked; of a large file that is the first part."""


@dataclass(frozen=True, slots=True)
class OpeningChoices:
    """What a person says of an event file that does not say it itself; nothing of it is left to the file."""

    sensor: SensorSize | None = None
    """Sensor of every camera in the file."""
    options: ImportOptions = field(default_factory=ImportOptions)

    def order(self, path: Path) -> ImportOrder:
        """The import of a file, as the person says."""
        return ImportOrder([path], sensor=self.sensor, options=self.options)


AS_THE_FILE_SAYS: Final = OpeningChoices()


def look_at(
    path: Path,
    library: Library,
    workspace: Workspace,
    *,
    choices: OpeningChoices = AS_THE_FILE_SAYS,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> ImportFacts | None:
    """What a file holds before `bring_in` makes a recording of it; None for what is one already, or if cancelled.

    Raises:
        RecordingError: if the file cannot be read.
    """
    if is_growing(path) or is_recording(path) or _known(path, workspace, choices)[2] is not None:
        return None
    return check_import(choices.order(path), longest_s=LONGEST_LOOK_S, progress=progress, cancelled=cancelled)


def bring_in(
    path: Path,
    library: Library,
    workspace: Workspace,
    *,
    choices: OpeningChoices = AS_THE_FILE_SAYS,
    received: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> str | None:
    """Name in the library of the recording that a file is or has become; None if `cancelled()` is true.

    A file that was `received` from a browser moves into the workspace if it is a recording already. What was brought
    in before is not brought in again. Nothing is ever overwritten, and nothing is left of what fails.

    Raises:
        RecordingError: if the file cannot be read, or the disk has no room for the result.
    """
    own = path.parent == workspace.recordings
    # Before anything is decoded: our own files are used where they are.
    if is_growing(path) or is_recording(path):
        if own:
            return path.stem
        return _keep_recording(path, workspace) if received else library.add_external(path)
    wanted, uuid, known = _known(path, workspace, choices)
    if known is not None:
        return known
    folder = incoming_folder(workspace)
    try:
        decoded = folder / "decoded.h5"
        watched = _watching_the_disk(folder, progress)
        if import_recording(choices.order(path), decoded, progress=watched, cancelled=cancelled) is None:
            return None
        return _place(decoded, workspace, wanted, uuid)
    finally:
        end_unfinished(folder)


def _known(path: Path, workspace: Workspace, choices: OpeningChoices) -> tuple[str, str, str | None]:
    """The name and the identity of the recording that an event file becomes, and its name if it is there already."""
    wanted = path.stem if path.parent == workspace.recordings else _slug(path.stem)
    try:
        status = path.stat()
    except OSError as error:
        raise RecordingError("the file cannot be opened", got=error.strerror, where=path) from error
    names = _source_names(path, status.st_size, status.st_mtime_ns, choices.sensor)
    uuid = choices.order(path).uuid(names)
    return wanted, uuid, _already_there(workspace, wanted, uuid)


@lru_cache(maxsize=16)
def _source_names(path: Path, size_bytes: int, changed_ns: int, sensor: SensorSize | None) -> list[str]:
    """The cameras of a file. Opening a large table takes seconds, and it is asked before the import and by it."""
    return [source.name for source in open_sources(path, sensor)]


def _keep_recording(path: Path, workspace: Workspace) -> str:
    with open_recording(path) as recording:  # this repairs one that was never closed
        uuid = recording.uuid
    return _place(path, workspace, _slug(path.stem), uuid, size_bytes=path.stat().st_size)


def _place(source: Path, workspace: Workspace, wanted: str, uuid: str, *, size_bytes: int | None = None) -> str:
    """Move a recording to the first free name with this stem, or reuse an identical one."""
    while True:
        known = _already_there(workspace, wanted, uuid, size_bytes=size_bytes)
        if known is not None:
            return known
        name = next(name for name in numbered(wanted) if not _path(workspace, name).exists())
        try:
            put_beside(source, _path(workspace, name))
        except FileExistsError:  # another process was quicker
            continue
        return name


def _already_there(workspace: Workspace, wanted: str, uuid: str, *, size_bytes: int | None = None) -> str | None:
    for name in numbered(wanted):
        path = _path(workspace, name)
        if not path.exists():
            return None
        if _uuid_of(path) == uuid and size_bytes in (None, path.stat().st_size):
            return name
    return None


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


MOST: Final = 2_000
"""Most files of one folder that are listed."""
OWN: Final = "recordings"


@dataclass(frozen=True, slots=True)
class OfferedFile:
    """One file in the list."""

    key: str
    """Random key, valid for this run of the app; it does not reveal the path."""
    path: Path
    folder: str
    """Name of the folder in the list."""
    kind: str
    size_bytes: int


@dataclass(eq=False, slots=True)
class OfferedFiles:
    """List of files to open; folders are read again each time. Thread-safe."""

    workspace: Workspace
    folders: tuple[Path, ...] = ()
    """Folders listed besides the workspace's recordings."""
    samples: tuple[tuple[Path, str], ...] = ()
    """Folders of sample recordings, and what each is called in the list; they come last."""
    _secret: bytes = field(default_factory=lambda: secrets.token_bytes(32), repr=False)
    _kinds: dict[tuple[Path, int, int], str | None] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def all(self) -> tuple[OfferedFile, ...]:
        """Every file that can be opened, by folder and name."""
        found: list[OfferedFile] = []
        for folder, called in self._places():
            try:
                paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
            except OSError:  # it was removed
                continue
            found += [file for path in paths[:MOST] if (file := self._offered(path, called)) is not None]
        return tuple(found)

    def find(self, key: str) -> OfferedFile | None:
        """File of a key, if it still exists."""
        return next((file for file in self.all() if hmac.compare_digest(file.key.encode(), key.encode())), None)

    def _places(self) -> list[tuple[Path, str]]:
        others = ((folder, folder.name or str(folder)) for folder in self.folders)
        return [(self.workspace.recordings, OWN), *others, *self.samples]

    def _offered(self, path: Path, folder: str) -> OfferedFile | None:
        try:
            status = path.stat()
        except OSError:
            return None
        kind = self._kind(path, status.st_size, status.st_mtime_ns)
        if kind is None:
            return None
        key = hmac.new(self._secret, str(path).encode("utf-8", "surrogateescape"), hashlib.sha256).hexdigest()[:32]
        return OfferedFile(key, path, folder, kind, status.st_size)

    def _kind(self, path: Path, size_bytes: int, changed_ns: int) -> str | None:
        known = (path, size_bytes, changed_ns)
        with self._lock:
            if known in self._kinds:
                return self._kinds[known]
        kind = kind_of(path)
        with self._lock:
            self._kinds[known] = kind
        return kind
