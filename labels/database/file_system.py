"""File systems of label stores: where many writers at a time are safe, where one is, and where none is."""

from __future__ import annotations

import os
import re
import uuid
from pathlib import Path
from typing import Final, NamedTuple

from core.errors import LabelError

try:
    import fcntl
except ImportError:  # Windows: its locks are not those of POSIX, and it has no table of mounts to find a network in
    fcntl = None

MOUNTS: Final = Path("/proc/mounts")
# fmt: off
NETWORK: Final = frozenset((
    "nfs", "nfs4", "cifs", "smb", "smb2", "smb3", "smbfs", "smbnetfs", "ncpfs", "9p", "afs", "ceph",
    "glusterfs", "lustre", "gpfs", "sshfs", "beegfs", "ocfs2", "gfs2",
))
WHOLE_FILES: Final = frozenset(("davfs", "davfs2", "s3fs", "rclone", "curlftpfs", "gcsfuse"))
# fmt: on
"""Types of file systems, without the `fuse.` in front of those that a program serves. Those of `WHOLE_FILES` send a
file as a whole, some time after it was written: to wait for the disk means nothing there, and the last one wins."""
JOURNAL_VARIABLE: Final = "RALLYSCOPE_LABEL_JOURNAL"
ROLLBACK: Final = "rollback"
"""Value of the variable for folders that several machines share and that the table of mounts does not show."""
_OCTAL = re.compile(r"\\([0-7]{3})")
_TRIED: set[Path] = set()
"""Folders in which everything that one writer needs was found to work."""


class Mount(NamedTuple):
    """A row of `/proc/mounts`."""

    source: str
    kind: str
    """Type of the file system."""
    options: str

    @property
    def is_network(self) -> bool:
        """Whether other machines may write to it."""
        return self.kind.removeprefix("fuse.") in NETWORK

    @property
    def sends_whole_files(self) -> bool:
        """Whether a change in the middle of a file reaches the disk only some time after it is closed."""
        return self.kind.removeprefix("fuse.") in WHOLE_FILES

    @property
    def is_windows_disk(self) -> bool:
        """Whether it is a disk of Windows, as a Linux within Windows (WSL) sees it: by 9p, virtiofs or its own type."""
        served = any(option.startswith("aname=drvfs") for option in self.options.split(","))
        return served or "drvfs" in (self.kind, self.source)


def is_shared(path: Path, mounts: str | None = None) -> bool:
    """Whether programs that see no locks or memory of this system may write to a path, which need not exist.

    `mounts` is the text of `/proc/mounts`; None: read it. `RALLYSCOPE_LABEL_JOURNAL=rollback` says so of every path.

    Raises:
        LabelError: if the variable says something else.
    """
    asked = os.environ.get(JOURNAL_VARIABLE, "")
    if asked not in ("", ROLLBACK):
        raise LabelError("unknown journal of labels", expected=ROLLBACK, got=asked, where=JOURNAL_VARIABLE)
    if asked:
        return True
    mount = mount_of(path, _read_mounts() if mounts is None else mounts)
    return mount is not None and (mount.is_network or mount.sends_whole_files or mount.is_windows_disk)


def refuse_whole_files(path: Path, mounts: str | None = None) -> None:
    """Do nothing for a path on a file system that writes into the middle of files.

    Raises:
        LabelError: if it is a store of whole files, such as a bucket or WebDAV.
    """
    mount = mount_of(path, _read_mounts() if mounts is None else mounts)
    if mount is not None and mount.sends_whole_files:
        raise LabelError(
            "labels cannot be kept here: this network drive sends whole files, and later than it says",
            expected="a disk of this machine, or a network folder such as NFS or SMB",
            got=mount.kind,
            where=path,
            remedy="choose a folder with --data, and copy the finished file",
        )


def refuse_unsafe_folder(folder: Path) -> None:
    """Do nothing where one writer at a time is safe: a file is made by one only, reaches the disk, and can be locked.

    Raises:
        LabelError: if one of them does not work; it says which.
    """
    if folder in _TRIED:
        return
    missing = _missing_in(folder)
    if missing:
        raise LabelError(
            "labels cannot be kept in this folder",
            expected="a file system on which a file is made by one program only, reaches the disk, and can be locked",
            got=missing,
            where=folder,
            remedy="choose a folder with --data, or mount it with locks (NFS: without nolock, with lockd running)",
        )
    _TRIED.add(folder)


def _missing_in(folder: Path) -> str:
    """What does not work in a folder; empty if everything does."""
    path = folder / f".trial-{uuid.uuid4().hex}"
    step = "a new file"
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            try:
                os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL))
                return "a file that was there was made a second time"
            except FileExistsError:
                pass
            step = "writing"
            os.write(descriptor, b"trial")
            step = "waiting for the disk (fsync)"
            os.fsync(descriptor)
            step = "a lock (fcntl)"
            if fcntl is not None:
                fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        finally:
            os.close(descriptor)
            path.unlink(missing_ok=True)
    except OSError as error:
        return f"{step} fails: {error.strerror}"
    return ""


def mount_of(path: Path, mounts: str) -> Mount | None:
    """The row of `/proc/mounts` that a path, which need not exist, lies on; None if there is none."""
    parts = path.resolve().parts
    best, depth = None, -1
    for line in mounts.splitlines():
        fields = line.split(" ")
        if len(fields) < 3:
            continue
        point = Path(_OCTAL.sub(lambda match: chr(int(match[1], 8)), fields[1])).parts
        if parts[: len(point)] == point and len(point) >= depth:  # of two on one place, the later one is seen
            best, depth = Mount(fields[0], fields[2], "".join(fields[3:4])), len(point)
    return best


def _read_mounts() -> str:
    try:
        return MOUNTS.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
