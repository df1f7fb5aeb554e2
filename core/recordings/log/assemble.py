"""From the log of a growing recording to plain HDF5, at the end of the writing or after a kill."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.files import POSIX, beside, numbered, replacing
from core.recordings import layout
from core.recordings.blocks import CHUNK_EVENTS, GZIP_LEVEL, pack_column, unpack_column
from core.recordings.hdf5 import HDF5_ERRORS
from core.recordings.log.contents import EventBlock, LogContents, read_contents, recovery_notes
from core.recordings.log.growing import Json, open_abandoned
from core.recordings.log.scanning import Frame
from core.recordings.ms_index import MsIndex

_COLUMNS = (("t", np.int64), ("x", np.uint16), ("y", np.uint16), ("p", np.uint8))
_TARGET_CHUNK_BYTES = 1 << 20


def assemble(
    path: Path, *, indices: Mapping[str, NDArray[np.uint64]] | None = None, destination: Path | None = None
) -> None:
    """Replace the log at `path` by the HDF5 file it describes, in one step: a kill in between leaves the log.

    `indices` are the millisecond indices when the writer itself is closing; without them the log is taken for one
    whose writer was killed: every frame is checked, and notes say what was recovered and what was lost. A damaged log
    is kept beside the file, under a name of its own. The log stays as it is if there is a `destination`.

    Raises:
        RecordingError: if the log has no beginning, its writer still works, or the disk is full.
    """
    target = destination or path
    with path.open("rb") if indices is not None else open_abandoned(path) as log:
        contents = read_contents(log, path, check=indices is None)
        if contents.gaps and indices is not None:  # damaged while it was written
            contents, indices = read_contents(log, path, check=True), None
        _check_space(target.parent, contents)
        partial = beside(target, ".", ".assembling")
        try:
            if indices is None:
                indices = {name: _index(log, blocks) for name, blocks in contents.blocks.items()}
                contents.notes += recovery_notes(contents, os.fstat(log.fileno()).st_size)
            if contents.damaged and destination is None:
                contents.notes[-1] += f" The damaged log is {_keep_log(path).name}."
            with replacing(target, durable=True, partial=partial):
                with h5py.File(partial, "w") as file:
                    _write(file, log, contents, indices)
                if not POSIX:
                    log.close()  # there nothing is replaced that is open
        except HDF5_ERRORS as error:
            raise RecordingError(
                "the recording could not be finished",
                got=error,
                where=path,
                remedy="free some space and open it again; nothing is lost",
            ) from error


def _index(log: BinaryIO, blocks: list[EventBlock]) -> NDArray[np.uint64]:
    index = MsIndex()
    for block in blocks:
        index.extend(_unpack(log, block, 0))
    return index.marks()


def _unpack(log: BinaryIO, block: EventBlock, column: int) -> NDArray:
    log.seek(block.offset + sum(block.sizes[:column]))
    return unpack_column(log.read(block.sizes[column]), _COLUMNS[column][1], (CHUNK_EVENTS,))[: block.count]


def _keep_log(path: Path) -> Path:
    """Give a damaged log a second name beside its own, which is taken over by what was recovered."""
    for ending in numbered(".damaged-log"):
        kept = beside(path, "", ending)
        if kept.exists():
            if kept.samefile(path):  # by an opening that was killed, or failed
                return kept
            continue
        try:
            os.link(path, kept)
        except FileExistsError:
            continue
        except OSError:  # a file system without hard links
            with replacing(kept, durable=True) as partial:
                shutil.copyfile(path, partial)
        return kept
    raise AssertionError


def _check_space(folder: Path, contents: LogContents) -> None:
    """A full disk makes HDF5 fail in ways that cannot be cleaned up, so look first."""
    free = shutil.disk_usage(folder).free
    needed = contents.end + (16 << 20)
    if free < needed:
        raise RecordingError(
            "the disk is too full to finish the recording",
            expected=f"{needed / 1e6:.0f} MB free",
            got=f"{free / 1e6:.0f} MB",
            where=folder,
            remedy="free some space and open it again; nothing is lost",
        )


def _write(file: h5py.File, log: BinaryIO, contents: LogContents, indices: Mapping[str, NDArray[np.uint64]]) -> None:
    start = contents.start
    offsets = cast("dict[str, int]", start["time_offsets_us"])
    calibration = cast("dict[str, dict[str, Json]]", start["calibration"])
    cameras = cast("dict[str, list[int]]", start["cameras"])
    duration_us = contents.duration_us
    for name, (width, height) in cameras.items():
        camera = file.create_group(f"/cameras/{name}")
        camera.attrs.update(width=width, height=height)
        camera.create_dataset("t_offset", data=np.int64(offsets.get(name, 0)))
        marks = indices[name]
        index = camera.create_dataset(
            "ms_to_idx",
            data=marks,
            **({"compression": "gzip", "compression_opts": 1, "shuffle": True} if len(marks) else {}),
        )
        index.flush()  # or its place in the file depends on when the object goes, which a profiler's thread may delay
        duration_us = max(duration_us, _write_events(file, log, name, contents.blocks[name]))
        for key, values in calibration.get(name, {}).items():
            file.create_dataset(f"{layout.calibration_group(name)}/{key}", data=np.array(values, np.float64))
        if layout.FISHEYE_DISTORTION in calibration.get(name, {}):
            file[layout.calibration_group(name)].attrs[layout.LENS_MODEL] = "fisheye"
    for name in cast("list[str]", start.get("frame_cameras", [])):  # logs of earlier versions do not say it
        if layout.frames_group(name) not in contents.rows:
            _write_no_pictures(file.create_group(layout.frames_group(name)), *cameras[name])
    for group, frames in contents.rows.items():
        _write_rows(file, log, group, frames)
    file["cameras"].attrs["order"] = list(cameras)
    file.attrs.update(
        format=layout.FORMAT, version=layout.VERSION, uuid=cast(str, start["uuid"]), duration_us=duration_us
    )
    for key in ("seed", "config"):
        if start[key] is not None:
            file.attrs[key] = start[key]
    if contents.notes:
        file.attrs["notes"] = contents.notes


def _write_no_pictures(group: h5py.Group, width: int, height: int) -> None:
    for name in ("t_us", "exposure_us"):
        group.create_dataset(name, (0,), np.int64)
    group.create_dataset("image", (0, height, width), np.uint8)


def _write_events(file: h5py.File, log: BinaryIO, camera: str, blocks: list[EventBlock]) -> int:
    """Copy the packed blocks into the datasets; returns the time just after the last event."""
    total = sum(block.count for block in blocks)
    datasets = [
        _create_column(file, f"{layout.events_group(camera)}/{name}", (total,), np.dtype(dtype), (CHUNK_EVENTS,))
        for name, dtype in _COLUMNS
    ]
    for number, columns in enumerate(_packed_chunks(log, blocks)):
        for dataset, packed in zip(datasets, columns, strict=True):
            dataset.id.write_direct_chunk((number * CHUNK_EVENTS,), packed)
    return int(_unpack(log, blocks[-1], 0)[-1]) + 1 if blocks else 0


def _packed_chunks(log: BinaryIO, blocks: list[EventBlock]) -> Iterator[list[bytes]]:
    """The four columns of each chunk: as they are, unless the end of a block in the middle is lost."""
    if all(block.count == CHUNK_EVENTS for block in blocks[:-1]):
        for block in blocks:
            log.seek(block.offset)
            yield [log.read(size) for size in block.sizes]
        return
    pending: list[NDArray] = [np.empty(0, dtype) for _, dtype in _COLUMNS]
    for block in blocks:
        pending = [np.concatenate([column, _unpack(log, block, k)]) for k, column in enumerate(pending)]
        while len(pending[0]) >= CHUNK_EVENTS:
            yield [pack_column(column[:CHUNK_EVENTS], CHUNK_EVENTS) for column in pending]
            pending = [column[CHUNK_EVENTS:] for column in pending]
    if len(pending[0]):
        yield [pack_column(column, CHUNK_EVENTS) for column in pending]


def _write_rows(file: h5py.File, log: BinaryIO, group: str, frames: list[Frame]) -> None:
    columns = cast("list[tuple[str, str, list[int]]]", frames[0].meta["columns"])
    total = sum(cast(int, frame.meta["count"]) for frame in frames)
    for number, (name, type_name, row_shape) in enumerate(columns):
        dtype = np.dtype(type_name)
        row_bytes = dtype.itemsize * int(np.prod(row_shape, dtype=np.int64))
        length = max(1, min(total, _TARGET_CHUNK_BYTES // max(1, row_bytes)))
        dataset = _create_column(file, f"{group}/{name}", (total, *row_shape), dtype, (length, *row_shape))
        chunk, filled, at = np.zeros((length, *row_shape), dtype), 0, 0
        for frame in frames:
            rows, done = _unpack_rows(log, frame, number), 0
            while done < len(rows):
                taken = min(length - filled, len(rows) - done)
                chunk[filled : filled + taken] = rows[done : done + taken]
                filled, done = filled + taken, done + taken
                if filled == length:
                    dataset.id.write_direct_chunk((at, *(0 for _ in row_shape)), pack_column(chunk, length))
                    filled, at = 0, at + length
        if filled:
            dataset.id.write_direct_chunk((at, *(0 for _ in row_shape)), pack_column(chunk[:filled], length))


def _unpack_rows(log: BinaryIO, frame: Frame, number: int) -> NDArray:
    sizes = cast("list[int]", frame.meta["sizes"])
    _, type_name, row_shape = cast("list[tuple[str, str, list[int]]]", frame.meta["columns"])[number]
    log.seek(frame.offset + sum(sizes[:number]))
    return unpack_column(log.read(sizes[number]), type_name, (cast(int, frame.meta["count"]), *row_shape))


def _create_column(
    file: h5py.File, name: str, shape: tuple[int, ...], dtype: np.dtype, chunks: tuple[int, ...]
) -> h5py.Dataset:
    return file.create_dataset(
        name,
        shape,
        dtype,
        chunks=chunks,
        maxshape=(None, *shape[1:]),
        compression="gzip",
        compression_opts=GZIP_LEVEL,
        shuffle=True,
    )
