"""Whether a folder lies on a network drive: SQLite's write-ahead log needs memory that all who write share."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from core.errors import LabelError

MOUNTS: Final = Path("/proc/mounts")
# fmt: off
NETWORK: Final = frozenset((
    "nfs", "nfs4", "cifs", "smb", "smb2", "smb3", "smbfs", "smbnetfs", "ncpfs", "9p", "afs", "ceph",
    "glusterfs", "lustre", "gpfs", "davfs", "davfs2", "sshfs", "s3fs", "rclone", "curlftpfs", "gcsfuse",
    "beegfs", "ocfs2", "gfs2",
))
# fmt: on
"""Types of file systems, without the `fuse.` in front of those that a program serves."""
_OCTAL = re.compile(r"\\([0-7]{3})")


def refuse_network_drive(path: Path, mounts: str | None = None) -> None:
    """Do nothing for a path on a disk of this machine. `mounts` is the text of `/proc/mounts`; None: read it.

    Raises:
        LabelError: if it is on a network drive.
    """
    kind = filesystem_of(path, _read_mounts() if mounts is None else mounts)
    if kind is not None and kind.removeprefix("fuse.") in NETWORK:
        raise LabelError(
            "labels cannot be kept on a network drive: two machines that write would damage them",
            expected="a disk of this machine",
            got=kind,
            where=path,
            remedy="choose a folder with --data, and copy the finished file",
        )


def filesystem_of(path: Path, mounts: str) -> str | None:
    """Type of the file system of a path, which need not exist; None if the table does not tell."""
    parts = path.resolve().parts
    best, depth = None, -1
    for line in mounts.splitlines():
        fields = line.split(" ")
        if len(fields) < 3:
            continue
        point = Path(_OCTAL.sub(lambda match: chr(int(match[1], 8)), fields[1])).parts
        if parts[: len(point)] == point and len(point) >= depth:  # of two on one place, the later one is seen
            best, depth = fields[2], len(point)
    return best


def _read_mounts() -> str:
    try:
        return MOUNTS.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
