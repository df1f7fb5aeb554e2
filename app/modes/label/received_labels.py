"""Puts files of labels that a browser sent where the import looks for them. Neither content nor names are trusted."""

from __future__ import annotations

import os
import shutil
import stat
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

from app.modes.label.comparer import FOLDER as STORES
from app.modes.label.comparer import SUFFIX as STORE_SUFFIX
from app.modes.label.label_files import FOLDER, MAX_ENTRIES
from app.shared.workspace import free_path
from app.web.uploads import KEPT_FREE_BYTES
from core.errors import LabelError
from core.files import numbered
from labels.store_contents import layers_of_store

MAX_FILES: Final = 20_000
MAX_UNPACKED_BYTES: Final = 200_000_000
DEEPEST: Final = 6
LONGEST_NAME: Final = 150
UNFIT: Final = frozenset(':*?"<>|')
"""Characters of no file name on Windows."""
PIECE_BYTES: Final = 1 << 20
ZIP_SUFFIX: Final = ".zip"


def place_label_file(path: Path, workspace: Path) -> str:
    """Place a received file for the import; returns the name by which the import lists it.

    A ZIP becomes a folder, a label store goes to the stores that can be compared with. `path` lies alone in its folder,
    in which a ZIP is unpacked; nothing of it appears in the workspace before all of it is there.

    Raises:
        LabelError: if it is no store or ZIP though it is called one, holds too much, or there are too many files.
        CommandError: if it cannot be written there.
    """
    if path.suffix == STORE_SUFFIX:
        layers_of_store(path)  # what is no store is refused
        return f"{STORES}/{_place(path, workspace / STORES)}"
    if path.suffix == ZIP_SUFFIX:
        unpacked = path.parent / "unpacked" / path.stem
        _unpack(path, unpacked)
        return _place(_innermost(unpacked), workspace / FOLDER, path.stem)
    return _place(path, workspace / FOLDER)


def _place(source: Path, folder: Path, name: str = "") -> str:
    """Move it into a folder under a name that is free there."""
    folder.mkdir(parents=True, exist_ok=True)
    if len(os.listdir(folder)) >= MAX_ENTRIES:
        raise LabelError("too many files wait there", expected=f"up to {MAX_ENTRIES}", where=folder.name)
    wanted = folder / (name or source.name)
    with free_path(wanted.with_name(stem + wanted.suffix) for stem in numbered(wanted.stem)) as free:
        shutil.move(source, free)
    return free.name


def _unpack(archive: Path, folder: Path) -> None:
    if shutil.disk_usage(archive.parent).free < MAX_UNPACKED_BYTES + KEPT_FREE_BYTES:
        raise LabelError("the server's disk is too full to unpack it")
    try:
        with zipfile.ZipFile(archive) as opened:
            _unpack_members(opened, folder)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, ValueError) as error:
        raise LabelError("not a ZIP file that can be read", got=str(error).removeprefix("File is ")) from error


def _unpack_members(archive: zipfile.ZipFile, folder: Path) -> None:
    left_bytes = MAX_UNPACKED_BYTES
    members = [one for one in archive.infolist() if not one.is_dir()]
    if len(members) > MAX_FILES:
        raise LabelError("too many files in the ZIP", expected=f"up to {MAX_FILES:,}", got=f"{len(members):,}")
    for member in members:
        parts = _parts_of(member)
        if any(part.startswith((".", "__MACOSX")) for part in parts):
            continue  # what systems add, and nobody labelled
        target = folder.joinpath(*parts)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(member) as source, target.open("xb") as out:
                for piece in _pieces(source):
                    left_bytes -= len(piece)
                    if left_bytes < 0:  # counted as it comes: what the ZIP says of its sizes may be wrong
                        expected = f"up to {MAX_UNPACKED_BYTES / 1e6:.0f} MB"
                        raise LabelError("too much in the ZIP", expected=expected, where=parts[-1])
                    out.write(piece)
        except OSError as error:
            raise LabelError("cannot unpack a file of the ZIP", got=error.strerror, where=repr(parts[-1])) from error
    if not folder.is_dir():
        raise LabelError("the ZIP holds no files")


def _parts_of(member: zipfile.ZipInfo) -> tuple[str, ...]:
    """Folders and name of a file in a ZIP; none of them leads anywhere else."""
    parts = tuple(member.filename.replace("\\", "/").split("/"))
    plain = all(
        0 < len(part) <= LONGEST_NAME and part not in (".", "..") and part.isprintable() and not UNFIT & set(part)
        for part in parts
    )
    if not plain or len(parts) > DEEPEST:
        raise LabelError("a ZIP with names that are no plain files", got=repr(member.filename[:LONGEST_NAME]))
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise LabelError("a ZIP with a compression that is not read", expected="stored or deflated files")
    if member.flag_bits & 1:
        raise LabelError("an encrypted ZIP", remedy="make one without a password")
    mode = member.external_attr >> 16
    if mode and stat.S_IFMT(mode) not in (0, stat.S_IFREG):
        raise LabelError("a ZIP with links", got=repr(parts[-1]), remedy="pack the files themselves")
    return parts


def _pieces(source: IO[bytes]) -> Iterator[bytes]:
    while piece := source.read(PIECE_BYTES):
        yield piece


def _innermost(folder: Path) -> Path:
    """The folder in which the files lie: many a ZIP holds one folder, and everything in that."""
    inside = list(folder.iterdir())
    while len(inside) == 1 and inside[0].is_dir():
        (folder,) = inside
        inside = list(folder.iterdir())
    return folder
