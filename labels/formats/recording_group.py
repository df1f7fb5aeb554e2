"""Labels in HDF5: the group `/labels/<camera>` of a recording, or of a file of its own.

A recording is never changed in place: a kill in the middle would damage hours of data. It is copied, the copy gets the
group, and takes the recording's place in one step.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

from core.errors import LabelError, RecordingError
from core.files import replacing
from core.recordings.hdf5 import HDF5_ERRORS, dataset_at, group_at, has_item, kind_at, names_in, read_whole
from labels.formats.exchange import Collector, Exported, ExportOptions, ImportContext, Imported, LabelSet
from labels.formats.flat import (
    COLUMNS,
    CONTACT_COLUMNS,
    REQUIRED,
    REQUIRED_OF_CONTACT,
    Value,
    contact_of_row,
    contact_row,
    flat_row,
    label_of_row,
)

VERSION = 1
CONTACTS = "contacts"
"""Group of the contacts within that of the camera; earlier versions pass over it."""
NO_NUMBER = -1
"""For whole numbers that a label does not say; all real ones are 0 or more."""


def write_hdf5(labels: LabelSet, path: Path, options: ExportOptions) -> Exported:
    """Into the recording at `path`, or into a new file if there is none; an earlier group of the camera is replaced.

    Raises:
        LabelError: if the file is another recording, or cannot be written.
    """
    try:
        with replacing(path, durable=True) as partial:
            if path.exists():
                shutil.copyfile(path, partial)
            with h5py.File(partial, "a") as file:
                write_group(file, labels, path)
    except OSError as error:
        raise LabelError("cannot write labels into it", got=error.strerror or error, where=path) from error
    return Exported((path,), ())


def write_group(file: h5py.File, labels: LabelSet, path: Path) -> None:
    """Put the labels into `/labels/<camera>` of an open file, in place of those that are there."""
    uuid = file.attrs.get("uuid", labels.recording_uuid)
    if uuid != labels.recording_uuid:
        raise LabelError("labels of another recording", expected=labels.recording_uuid, got=uuid, where=path)
    file.attrs["uuid"] = uuid
    name = f"/labels/{_group_name(labels.camera)}"
    if name in file:
        del file[name]
    group = file.create_group(name)
    group.attrs["version"] = VERSION
    group.attrs["annotator"] = labels.annotator
    group.attrs["coordinates"] = "pixel centres at whole numbers, distorted picture"
    group.attrs["width"], group.attrs["height"] = labels.sensor.width_px, labels.sensor.height_px
    _write_columns(group, COLUMNS, [flat_row(label) for label in labels.labels])
    if labels.contacts:
        contacts = group.create_group(CONTACTS)
        _write_columns(contacts, CONTACT_COLUMNS, [contact_row(contact) for contact in labels.contacts])


def _write_columns(group: h5py.Group, columns: Mapping[str, type], rows: list[dict[str, Value]]) -> None:
    for column, kind in columns.items():
        values = [row[column] for row in rows]
        group.create_dataset(column, data=_column(values, kind), compression="gzip" if rows else None)


def _column(values: list[Value], kind: type) -> np.ndarray:
    if kind is str:
        encoded = [str(value).encode() for value in values]
        return np.array(encoded, f"S{max(map(len, encoded), default=1) or 1}")
    if kind is int:
        return np.array([NO_NUMBER if value is None else value for value in values], np.int64)
    return np.array([np.nan if value is None else value for value in values], np.float64)


def read_hdf5(path: Path, context: ImportContext) -> Imported:
    """The labels of the context's camera, or of the only one in the file; rejections count rows from 1."""
    collector = Collector()
    if not path.is_file():
        collector.reject(path, 1, "no such file")
        return collector.done()
    try:
        with h5py.File(path, "r") as file:
            read_labels(file, path, context, collector)
    except (*HDF5_ERRORS, RecordingError) as error:
        collector.reject(path, 1, f"not a readable HDF5 file: {error}")
    return collector.done()


def read_labels(file: h5py.File, path: Path, context: ImportContext, collector: Collector) -> None:
    """Read those of the context's camera, or of the only one in an open file."""
    groups = group_at(file, "labels") if has_item(file, "labels") else None
    names = sorted(names_in(groups)) if groups is not None else []
    chosen = _group_name(context.camera) if context.camera else (names[0] if len(names) == 1 else "")
    if groups is None or chosen not in names:
        collector.reject(path, 1, f"no labels of camera {context.camera!r}; under /labels are {names}")
        return
    if kind_at(groups, chosen) is not h5py.Group:  # or a link to another file, which is not followed
        collector.reject(path, 1, "not a group of columns")
        return
    collector.is_of(context, path, context.camera, file.attrs.get("uuid"))
    read_group(group_at(groups, chosen), path, context, collector)


def _group_name(camera: str) -> str:
    return camera.replace("/", "%2F")


def read_group(group: h5py.Group, path: Path, context: ImportContext, collector: Collector) -> None:
    """The labels of one `/labels/<camera>`."""
    for line, texts in _rows(group, COLUMNS, REQUIRED, path, collector):
        with collector.entry(path, line):
            collector.add(label_of_row(texts, context.origin), path, line)
    if kind_at(group, CONTACTS) is h5py.Group:
        within = group_at(group, CONTACTS)
        for line, texts in _rows(within, CONTACT_COLUMNS, REQUIRED_OF_CONTACT, path, collector):
            with collector.entry(path, line):
                collector.add_contact(contact_of_row(texts, context.origin), path, line)


def _rows(
    group: h5py.Group, kinds: Mapping[str, type], required: Sequence[str], path: Path, collector: Collector
) -> Iterator[tuple[int, dict[str, str]]]:
    """(number from 1, texts by column) of each row; nothing after a rejection of the columns."""
    columns = {name: read_whole(dataset_at(group, name)) for name in kinds if kind_at(group, name) is h5py.Dataset}
    missing = set(required) - set(columns)
    if missing or len({np.shape(column) for column in columns.values()}) != 1:
        collector.reject(path, 1, f"columns of /labels are missing or differ in length: {sorted(missing)}")
        return
    for row in range(len(columns["t_us"])):
        with collector.entry(path, row + 1):
            texts = {name: _text(column[row], kinds[name]) for name, column in columns.items()}
            yield row + 1, texts


def _text(value: object, kind: type) -> str:
    if kind is str:
        return value.decode() if isinstance(value, bytes) else str(value)
    if kind is int:
        return "" if value == NO_NUMBER else str(value)
    return "" if np.isnan(value) else repr(float(value))  # pyright: ignore[reportCallIssue, reportArgumentType]
