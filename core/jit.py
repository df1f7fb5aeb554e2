"""Compiling the hot loops once per machine: numba's `njit` with a cache that is never stale.

Numba's own cache looks at the file of a kernel only. A kernel that calls another, or reads a constant, of a file that
was edited since keeps running the old code, and two processes that compile at the same time may exchange each other's
code. Here a compiled kernel is found by the hash of all that it was made of: its file and all of ours which that file
imports, directly or not, the types of its arguments, the processor, and the versions of Python and numba.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import logging
import os
import pickle
import re
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numba
from numba.core import config
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

from core.files import replace_file

logger = logging.getLogger(__name__)

OURS: Final = frozenset({"app", "benchmarks", "core", "labels"})
KEPT_S: Final = 30 * 24 * 3600.0
"""Kernels of other versions of a file are deleted after this time."""
SETTINGS: Final = ("OPT", "BOUNDSCHECK", "DEBUGINFO_DEFAULT")
"""Settings of numba that change the compiled code."""
_IMPORT = re.compile(r"^(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n#]+)|import\s+([\w., ]+))", re.MULTILINE)

_known: set[str] = set()
_ready: set[str] = set()


def njit(function: Callable | None = None, **options: Any) -> Any:
    """`numba.njit` without the GIL and with the cache of this module; takes the same options."""
    if function is None:
        return functools.partial(njit, **options)
    dispatcher = numba.njit(nogil=True, **options)(function)
    if isinstance(dispatcher, Dispatcher):  # with NUMBA_DISABLE_JIT it is the plain function
        cache = KernelCache(function)
        dispatcher._cache = cache  # pyright: ignore[reportAttributeAccessIssue] - where numba puts its own
        _known.add(cache.name)
    return dispatcher


def kernels_ready(*packages: str) -> tuple[int, int]:
    """How many kernels of some packages this process has compiled or loaded, of how many it has imported.

    A kernel that only others call is loaded with them, and does not count.
    """
    ready, known = (sum(name.startswith(packages) for name in tuple(names)) for names in (_ready, _known))
    return ready, known


class KernelCache:
    """Compiled code of one function, one file per signature in a folder of its own. Safe to share by processes.

    It has what numba's dispatcher expects of a cache.
    """

    def __init__(self, function: Callable) -> None:
        self._source = Path(inspect.getfile(function))
        self._function = function
        self.name = f"{function.__module__}.{function.__qualname__}"
        self._enabled = True

    @property
    def cache_path(self) -> str | None:
        """The folder of this function; None if there is nowhere to keep anything."""
        folder = cache_folder()
        return None if folder is None else str(folder / re.sub(r"[^\w.]", "", self.name))

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """What was compiled for these types before."""
        target_context.refresh()
        path = self._path(sig, target_context.codegen())
        payload = None if path is None else _read_checked(path)
        if payload is None:
            return None
        _ready.add(self.name)
        return CompileResult._rebuild(target_context, *pickle.loads(payload))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled; where that is impossible it is compiled again next time."""
        _ready.add(self.name)
        path = self._path(sig, data.codegen)
        if path is None or data.library.has_dynamic_globals or any(not lifted.can_cache for lifted in data.lifted):
            return
        try:
            _write_checked(path, dumps(data._reduce()))
            _drop_old(path.parent)
        except OSError as error:
            logger.debug("compiled code is not kept: %s", error)

    def enable(self) -> None:
        """Let the cache be used."""
        self._enabled = True

    def disable(self) -> None:
        """Let everything be compiled anew."""
        self._enabled = False

    def flush(self) -> None:
        """Forget everything about this function."""
        if self.cache_path is not None:
            for path in Path(self.cache_path).glob("*.kernel"):
                path.unlink(missing_ok=True)

    def _path(self, sig: Any, codegen: Any) -> Path | None:
        folder = self.cache_path
        if folder is None or not self._enabled:
            return None
        made_of = (
            source_stamp(self._source),
            self._function.__code__.co_firstlineno,  # two functions of one name in a file
            tuple(map(str, sig)) if isinstance(sig, tuple) else str(sig),
            codegen.magic_tuple(),
            sys.version_info,
            numba.__version__,
            tuple(str(getattr(config, name)) for name in SETTINGS),
        )
        return Path(folder) / f"{hashlib.blake2b(repr(made_of).encode(), digest_size=16).hexdigest()}.kernel"


@functools.cache
def cache_folder() -> Path | None:
    """Where compiled kernels are kept; None if nothing that is ours alone can be written.

    `NUMBA_CACHE_DIR` if it is set, else this user's folder for caches, else a private folder among temporary files.
    """
    wanted = os.environ.get("NUMBA_CACHE_DIR")
    temporary = Path(tempfile.gettempdir()) / f"rallyscope-{getattr(os, 'geteuid', lambda: 0)()}"
    places = [Path(wanted)] if wanted else [Path(AppDirs("rallyscope", appauthor=False).user_cache_dir), temporary]
    for place in places:
        folder = place / "rallyscope-kernels"
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            folder = folder.resolve()  # a link on the way may lead elsewhere later
            if _is_private(folder):
                tempfile.TemporaryFile(dir=folder).close()
                return folder
    logger.warning(
        "compiled code cannot be kept (%s, or a folder above it, is not writable, or others may write there): every "
        "start compiles again",
        places[0],
    )
    return None


@functools.cache
def source_stamp(source: Path) -> str:
    """Hash of a source file and of all files of ours that it imports, directly or not."""
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(_closure(source.resolve())):
        digest.update(hashlib.blake2b(path.read_bytes()).digest())
    return digest.hexdigest()


def _closure(source: Path) -> set[Path]:
    root, package = _root_of(source)
    found, open_ones = {source}, [source]
    while open_ones:
        for path in _imported_by(open_ones.pop(), root, package):
            if path not in found:
                found.add(path)
                open_ones.append(path)
    return found


@functools.cache
def _imported_by(source: Path, root: Path, package: str) -> frozenset[Path]:
    """Files of our packages that a file names in the imports at its left margin."""
    names: set[str] = set()
    for match in _IMPORT.finditer(source.read_text(encoding="utf-8")):
        module, imported, plain = match.groups()
        if module:
            names |= {module} | {f"{module}.{name}" for name in re.findall(r"(\w+)(?:\s+as\s+\w+)?", imported)}
        else:
            names |= {name.split()[0] for name in plain.split(",") if name.strip()}
    paths = set()
    for name in names:
        if name.partition(".")[0] in OURS | {package}:
            place = root.joinpath(*name.split("."))
            paths |= {path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()}
    return frozenset(paths)


def _root_of(source: Path) -> tuple[Path, str]:
    """The folder that holds a file's top-level package, and the package's name; the file's own folder without one."""
    folder = source.parent
    while (folder / "__init__.py").exists():
        folder = folder.parent
    return folder, source.relative_to(folder).parts[0].removesuffix(".py")


def _is_private(folder: Path) -> bool:
    """Whether nobody but this user and root can put code into a folder, or another folder into its place."""
    if not hasattr(os, "geteuid"):
        return True
    user = os.geteuid()
    trusted = {user, 0, _unknown_owner()}
    for place in (folder, *folder.parents):
        facts = place.stat()
        # of a sticky folder, such as /tmp, others may add to it, but not rename what is ours
        sticky = place != folder and facts.st_mode & stat.S_ISVTX
        if facts.st_uid not in ({user} if place == folder else trusted) or (_others_may_write(facts) and not sticky):
            return False
    return True


def _unknown_owner() -> int | None:
    """Number that a container shows for owners it does not know, such as of its root folder; None outside of one."""
    try:
        users = Path("/proc/self/uid_map").read_text(encoding="ascii").split()
    except OSError:
        return None
    return None if users == ["0", "0", "4294967295"] else 65534


def _others_may_write(facts: os.stat_result) -> bool:
    by_group = facts.st_mode & stat.S_IWGRP and not _is_own_group(facts.st_gid)
    return bool(facts.st_mode & stat.S_IWOTH or by_group)


def _is_own_group(group: int) -> bool:
    """Whether it is this user's group alone: many systems give every user one, and let it write by default."""
    import grp  # late: Windows has neither, nor this question
    import pwd

    try:
        user, facts = pwd.getpwuid(os.geteuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return user.pw_gid == group and facts.gr_name == user.pw_name and not set(facts.gr_mem) - {user.pw_name}


def _read_checked(path: Path) -> bytes | None:
    """The content that was written; None if there is none or it is damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, payload = data[:16], data[16:]
    return payload if hashlib.blake2b(payload, digest_size=16).digest() == digest else None


def _write_checked(path: Path, payload: bytes) -> None:
    replace_file(path, hashlib.blake2b(payload, digest_size=16).digest() + payload, durable=False)


def _drop_old(folder: Path) -> None:
    for path in folder.iterdir():
        with contextlib.suppress(OSError):
            if time.time() - path.stat().st_mtime > KEPT_S:
                path.unlink()
