"""A folder with one event file per camera: which files those are, and what their cameras are called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import h5py

from core.recordings.sources.readers import event_files

TEXT: Final = (".csv", ".txt")
"""Often something else, such as times of triggers: taken only in folders without other event files."""
TRUTH: Final = "ground_truth_"
"""Tables that `export --csv` writes beside those of the cameras."""
LABELS: Final = ("_label.h5", "_labels.h5")


def camera_files(folder: Path) -> list[Path]:
    """The event files in a folder by name; where it has none itself, the only one of each of its folders."""
    found = _files(folder)
    if found:
        return found
    inside = [_files(one) for one in sorted(folder.iterdir()) if one.is_dir()]
    return [files[0] for files in inside if len(files) == 1]


def camera_names(paths: Sequence[Path]) -> list[str]:
    """A name for the camera of each file: what its name does not share with the others, or its folder's name."""
    stems = [path.stem.split(".") for path in paths]
    if len({parts[0] for parts in stems}) == 1 and all(len(parts) > 1 for parts in stems):
        stems = [parts[1:] for parts in stems]  # pair.left.raw, pair.right.raw
    names = ["-".join(parts) for parts in stems]
    if len(set(names)) < len(names):  # left/events.h5, right/events.h5
        names = [path.resolve().parent.name for path in paths]
    return [re.sub(r"[^A-Za-z0-9_-]", "-", name) for name in names]


def _files(folder: Path) -> list[Path]:
    known = event_files()
    suffixes = {*known, ".h5"}
    files = [
        path
        for path in sorted(folder.iterdir())
        if path.is_file()
        and path.suffix.lower() in suffixes
        and not path.name.startswith(".")
        and not path.name.lower().endswith(LABELS)
        and not _is_recording(path)
    ]
    others = [path for path in files if path.suffix.lower() not in TEXT]
    return others or [path for path in files if not path.name.startswith(TRUTH)]


def _is_recording(path: Path) -> bool:
    """Whether it is a recording of ours, such as an earlier import into this folder."""
    if path.suffix.lower() not in (".h5", ".hdf5"):
        return False
    try:
        with h5py.File(path, "r") as file:
            return "rallyscope" in str(file.attrs.get("format", ""))
    except OSError:
        return False
