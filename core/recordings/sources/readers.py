"""The formats of event files, ours and those of plugins: how each is recognised, and how it is opened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import PluginError
from core.events import SensorSize
from core.recordings.sources.source import EventSource
from core.registry import Registry

HEAD_BYTES: Final = 4096
"""Bytes at the start of a file, by which it is recognised."""
Recognise = Callable[[Path, bytes], bool]
Open = Callable[[Path, SensorSize | None], list[EventSource]]


@dataclass(frozen=True, slots=True)
class Reader:
    """A format of event files, as `register_reader` describes it."""

    recognises: Recognise
    opens: Open
    label: str
    suffixes: tuple[str, ...]
    only_named: tuple[str, ...] = ()
    """In lists only files with one of these suffixes are of this format, since its files can hold anything: text,
    archives and data bases. Empty: every file that is recognised."""
    folders: bool = False
    """Whether a folder can be one recording of this format."""


READERS: Final[Registry[Reader]] = Registry("reader", "rallyscope.readers")
"""Every format by name; of those that recognise a file the one that was registered last opens it."""


def register_reader(
    name: str,
    recognises: Recognise,
    opens: Open,
    label: str,
    suffixes: tuple[str, ...] = (),
    only_named: tuple[str, ...] = (),
    *,
    folders: bool = False,
) -> None:
    """Add a format of event files: to `import`, to every verb that opens a recording, and to the app's Open file.

    Args:
        name: of the format.
        recognises: says of a path and the first HEAD_BYTES of the file whether it is of this format. It is asked
            before all that were registered earlier, ours among them.
        opens: gives the sources in the file, one for each camera; a size that is given counts more than the file's.
        label: what the format is called.
        suffixes: of files in the workspace's folder of recordings that the app offers, such as ".xyz".
        only_named: suffixes that a file needs to be listed, for a format whose files can hold anything.
        folders: whether `recognises` is asked of folders, too, with no first bytes.

    Raises:
        PluginError: if the name is taken, or one of these does not fit.
    """
    where = f"reader {name}"
    if not callable(recognises) or not callable(opens):
        raise PluginError("no way to read it", expected="recognises(path, head) and opens(path, sensor)", where=where)
    if not isinstance(label, str) or not label.strip():
        raise PluginError("no label", expected="what the format is called", got=repr(label), where=where)
    for given in (suffixes, only_named):
        if not isinstance(given, tuple) or not all(one.startswith(".") and one == one.lower() for one in given):
            raise PluginError("not suffixes", expected='such as (".xyz",)', got=repr(given), where=where)
    READERS.register(name, Reader(recognises, opens, label, suffixes, only_named, folders))


def event_files() -> dict[str, str]:
    """What files are called by the end of their name, of every format that has such an end."""
    return {suffix: reader.label for reader in READERS.values() for suffix in reader.suffixes}


def recognised(path: Path, head: bytes) -> Reader | None:
    """The reader that opens a file with these first bytes, or a folder: the last that recognises it."""
    folder = path.is_dir()
    asked = (reader for reader in reversed(list(READERS.values())) if reader.folders or not folder)
    return next((reader for reader in asked if reader.recognises(path, head)), None)
