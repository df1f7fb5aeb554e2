"""The files that a browser may open: those of the workspace, and of the folders that the command line named.

A browser gets a key for each and sends it back; a path never comes from a browser.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from app.shared.workspace import Workspace
from core.recordings.sources.kinds import kind_of

MOST: Final = 2_000
"""Files of one folder that are looked at."""
OWN: Final = "recordings"


@dataclass(frozen=True, slots=True)
class OfferedFile:
    """One file of the list."""

    key: str
    """For this run of the app; says nothing of the path."""
    path: Path
    folder: str
    """What the folder is called in the list."""
    kind: str
    size_bytes: int


@dataclass(eq=False, slots=True)
class OfferedFiles:
    """Thread-safe; the folders are read anew each time, because files come and go."""

    workspace: Workspace
    folders: tuple[Path, ...] = ()
    """Beside the workspace's recordings."""
    _secret: bytes = field(default_factory=lambda: secrets.token_bytes(32), repr=False)
    _kinds: dict[tuple[Path, int, int], str | None] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def all(self) -> tuple[OfferedFile, ...]:
        """Every file that can be opened, by folder and name."""
        found: list[OfferedFile] = []
        for folder, called in self._places():
            try:
                paths = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
            except OSError:  # it was taken away
                continue
            found += [file for path in paths[:MOST] if (file := self._offered(path, called)) is not None]
        return tuple(found)

    def find(self, key: str) -> OfferedFile | None:
        """The file of a key, if it is still there."""
        return next((file for file in self.all() if hmac.compare_digest(file.key.encode(), key.encode())), None)

    def _places(self) -> list[tuple[Path, str]]:
        return [(self.workspace.recordings, OWN), *((folder, folder.name or str(folder)) for folder in self.folders)]

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
