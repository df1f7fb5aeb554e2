"""Typed access into HDF5 files; h5py itself returns unions that say nothing."""

from __future__ import annotations

from typing import Any

import h5py
from numpy.typing import NDArray

from core.errors import RecordingError


def group_at(parent: h5py.Group, name: str) -> h5py.Group:
    """The group of that name.

    Raises:
        RecordingError: if there is none.
    """
    item = parent.get(name)
    if not isinstance(item, h5py.Group):
        raise RecordingError(f"group {name} is missing", where=f"{parent.file.filename}{parent.name}")
    return item


def dataset_at(parent: h5py.Group, name: str) -> h5py.Dataset:
    """The dataset of that name.

    Raises:
        RecordingError: if there is none.
    """
    item = parent.get(name)
    if not isinstance(item, h5py.Dataset):
        raise RecordingError(f"dataset {name} is missing", where=f"{parent.file.filename}{parent.name}")
    return item


def attribute(item: h5py.Group | h5py.Dataset, name: str) -> Any:
    """The attribute of that name; numbers are numpy scalars, text is `str`.

    Raises:
        RecordingError: if there is none.
    """
    if name not in item.attrs:
        raise RecordingError(f"attribute {name} is missing", where=f"{item.file.filename}{item.name}")
    return item.attrs[name]


def read_only(array: NDArray) -> NDArray:
    """The array, closed for writing."""
    array.flags.writeable = False
    return array
