"""What has to be the same in all processes that work on the pieces of one job."""

from __future__ import annotations

import functools
import hashlib
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from core.errors import JobsError

PACKAGES: Final = ("numpy", "numba", "distributed")
ROOT: Final = Path(__file__).parents[2]
OURS: Final = ("app", "core", "labels")

Versions = Mapping[str, str]


@functools.cache
def versions_here() -> dict[str, str]:
    """Of this process; that of rallyscope has a hash of its source, so that an edited copy is another version."""
    found = {"python": platform.python_version(), "rallyscope": f"{_version('rallyscope')}+{_source_hash()}"}
    return found | {name: _version(name) for name in PACKAGES}


def check_versions(expected: Versions, got: Versions, where: str) -> None:
    """Raises JobsError, in one line with all differences, if a worker is not as we are."""
    wrong = [name for name, value in expected.items() if got.get(name) != value]
    if wrong:
        raise JobsError(
            "a worker has other versions than this process",
            expected=", ".join(f"{name} {expected[name]}" for name in wrong),
            got=", ".join(f"{name} {got.get(name, 'none')}" for name in wrong),
            where=where,
            remedy="install the same on all machines of the cluster",
        )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


def _source_hash() -> str:
    digest = hashlib.blake2b(digest_size=4)
    for path in sorted(path for part in OURS for path in (ROOT / part).rglob("*.py")):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
