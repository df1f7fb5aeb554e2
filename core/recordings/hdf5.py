"""Typed access into HDF5 files that may be damaged, or made by somebody else.

h5py returns unions that say nothing, raises what its library happens to, and follows links into other files of the
disk. Here everything is of the expected kind and lies in the file itself, or there is one clear line.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from core.errors import RallyscopeError, RecordingError

HDF5_ERRORS: Final = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    OverflowError,
    AttributeError,
    MemoryError,
)
"""What h5py raises over damaged bytes, by where they lie, and over sizes that no memory holds."""
MAX_LINKS: Final = 8
LARGEST_BYTES: Final = 4 << 30
"""Largest dataset that is read as a whole."""
LARGEST_RATIO: Final = 1100
"""Deflate makes nothing smaller than by 1032: stored bytes that claim to be more were never written."""


@contextmanager
def hdf5_errors(what: str, where: object) -> Iterator[None]:
    """Turn what h5py raises in a block into a RecordingError."""
    try:
        yield
    except HDF5_ERRORS as error:
        got = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordingError(what, got=got, where=where) from error


def place_of(item: h5py.Group | h5py.Dataset) -> str:
    """File and path within it, for a message."""
    return f"{item.file.filename}{item.name}"


def group_at(parent: h5py.Group, name: str) -> h5py.Group:
    """The group of that name or path, in this file.

    Raises:
        RecordingError: if there is none.
    """
    item = _item_at(parent, name, MAX_LINKS)
    if not isinstance(item, h5py.Group):
        raise RecordingError(f"group {name} is missing", where=place_of(parent))
    return item


def dataset_at(parent: h5py.Group, name: str) -> h5py.Dataset:
    """The dataset of that name or path, whose values are in this file.

    Raises:
        RecordingError: if there is none.
    """
    item = _item_at(parent, name, MAX_LINKS)
    if not isinstance(item, h5py.Dataset):
        raise RecordingError(f"dataset {name} is missing", where=place_of(parent))
    with hdf5_errors(f"dataset {name} cannot be read", place_of(parent)):
        elsewhere = bool(item.is_virtual or item.external)
    if elsewhere:
        what, remedy = f"dataset {name} holds no values of its own", "write the values themselves into the file"
        kind = (
            "a virtual dataset, a view of others in this or another file"
            if item.is_virtual
            else "values in another file"
        )
        raise RecordingError(what, got=kind, where=place_of(parent), remedy=remedy)
    return item


def has_item(parent: h5py.Group, path: str) -> bool:
    """Whether a group or dataset is there and can be opened."""
    return kind_at(parent, path) is not None


def kind_at(parent: h5py.Group, path: str) -> type | None:
    """`h5py.Group` or `h5py.Dataset`, if one is there and can be opened."""
    try:
        item = _item_at(parent, path, MAX_LINKS)
    except RecordingError:
        return None
    return next((kind for kind in (h5py.Group, h5py.Dataset) if isinstance(item, kind)), None)


def names_in(group: h5py.Group) -> list[str]:
    """What a group says it holds.

    Raises:
        RecordingError: if it cannot be read.
    """
    with hdf5_errors("the group cannot be read", place_of(group)):
        return [str(name) for name in group]


def has_attribute(item: h5py.Group, name: str) -> bool:
    """Whether there is one of that name.

    Raises:
        RecordingError: if the attributes cannot be read.
    """
    with hdf5_errors("attributes cannot be read", place_of(item)):
        return name in item.attrs


def attribute(item: h5py.Group | h5py.Dataset, name: str) -> Any:
    """The attribute of that name; numbers are numpy scalars, text is `str`.

    Raises:
        RecordingError: if there is none.
    """
    with hdf5_errors(f"attribute {name} cannot be read", place_of(item)):
        if name in item.attrs:
            return item.attrs[name]
    raise RecordingError(f"attribute {name} is missing", where=place_of(item))


def whole_number(item: h5py.Group | h5py.Dataset, name: str, low: int, high: int) -> int:
    """The attribute of that name as a number from `low` to `high`.

    Raises:
        RecordingError: if it is missing, no whole number, or out of range.
    """
    value = np.asarray(attribute(item, name))
    if value.shape != () or value.dtype.kind not in "iu" or not low <= int(value) <= high:
        expected = f"a whole number, {low} to {high}"
        raise RecordingError(f"attribute {name} is damaged", expected=expected, got=_short(value), where=place_of(item))
    return int(value)


def text_of(item: h5py.Group | h5py.Dataset, name: str) -> str:
    """The attribute of that name as text.

    Raises:
        RecordingError: if it is missing or something else.
    """
    value = attribute(item, name)
    if not isinstance(value, str):
        raise RecordingError(f"attribute {name} is damaged", expected="text", got=_short(value), where=place_of(item))
    return value


def check_stored(dataset: h5py.Dataset) -> None:
    """Check that the values a dataset claims to have can be in the file.

    Raises:
        RecordingError: if they are more than what is stored can hold.
    """
    with hdf5_errors("the column cannot be read", place_of(dataset)):
        size, stored = int(dataset.nbytes), int(dataset.id.get_storage_size())
    if size > LARGEST_RATIO * stored + 4096:
        expected, got = f"{size} bytes", f"{stored} stored"
        raise RecordingError("the column is not all there", expected=expected, got=got, where=place_of(dataset))


def read_whole(dataset: h5py.Dataset) -> NDArray:
    """All values of a dataset, read-only.

    Raises:
        RecordingError: if they cannot be read, or claim to be more than what is stored can be.
    """
    check_stored(dataset)
    if dataset.nbytes > LARGEST_BYTES:
        raise RecordingError("the column is too large", got=f"{dataset.nbytes} bytes", where=place_of(dataset))
    with hdf5_errors("the column cannot be read", place_of(dataset)):
        return read_only(np.asarray(dataset[()]))


def read_only(array: NDArray) -> NDArray:
    """The array, closed for writing."""
    array.flags.writeable = False
    return array


class DamageNotes:
    """Notes in the order in which they were made, each once; any thread may add one."""

    def __init__(self) -> None:
        self._notes: dict[str, None] = {}

    @property
    def texts(self) -> tuple[str, ...]:
        """All so far, one line each."""
        return tuple(self._notes.copy())

    def add(self, text: str) -> None:
        """Say something about the file."""
        self._notes.setdefault(" ".join(text.split()))

    @contextmanager
    def left_out(self, what: str) -> Iterator[None]:
        """Go on without what cannot be read in a block, with a note that says why."""
        try:
            yield
        except RallyscopeError as error:
            self.add(f"{what[0].upper()}{what[1:]}: left out, {error}.")


def _item_at(parent: h5py.Group, path: str, links: int) -> object:
    """What lies there, by way of soft links at most: a link to another file is never followed. None if nothing does."""
    with hdf5_errors(f"{path} cannot be read", place_of(parent)):
        here: object = parent.file["/"] if path.startswith("/") else parent
        for part in filter(None, path.split("/")):
            link = here.get(part, getlink=True) if isinstance(here, h5py.Group) else None
            if isinstance(link, h5py.ExternalLink):
                raise RecordingError(f"{path} is a link to another file", got=link.filename, where=place_of(parent))
            if isinstance(link, h5py.SoftLink):
                here = _item_at(here, link.path, links - 1) if links and isinstance(here, h5py.Group) else None
            elif link is None or not isinstance(here, h5py.Group):
                return None
            else:
                here = here.get(part)
        return here


def _short(value: object) -> str:
    return " ".join(repr(value).split())[:80]
