"""From the log of a growing recording to plain HDF5, at the end of the writing or after a kill."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, cast

import h5py
import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.files import replacing
from core.recordings import layout
from core.recordings.blocks import CHUNK_EVENTS, GZIP_LEVEL, pack_column, unpack_column
from core.recordings.growing import Frame, Json, open_abandoned, scan
from core.recordings.ms_index import MsIndex

_COLUMNS = (("t", np.int64), ("x", np.uint16), ("y", np.uint16), ("p", np.uint8))
_TARGET_CHUNK_BYTES = 1 << 20


@dataclass(slots=True)
class _Contents:
    """What the log holds, by where it lies."""

    start: dict[str, Json]
    blocks: dict[str, list[tuple[int, int, tuple[int, ...]]]]
    """Per camera and block: events, offset in the log, packed size of each column."""
    rows: dict[str, list[Frame]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    duration_us: int = 0
    end: int = 0


def assemble(
    path: Path, *, indices: Mapping[str, NDArray[np.uint64]] | None = None, destination: Path | None = None
) -> None:
    """Replace the log at `path` by the HDF5 file it describes, in one step: a kill in between leaves the log.

    `indices` are the millisecond indices when the writer itself is closing; without them the log is taken for one
    whose writer was killed: every frame is checked, and a note says what was recovered. The log stays if there is a
    `destination`.

    Raises:
        RecordingError: if the log has no beginning, its writer still works, or the disk is full.
    """
    target = destination or path
    with path.open("rb") if indices is not None else open_abandoned(path) as log:
        contents = _read_contents(log, path, check=indices is None)
        if indices is None:
            indices = {name: _index(log, blocks) for name, blocks in contents.blocks.items()}
            contents.notes.append(_recovery_note(contents, os.fstat(log.fileno()).st_size))
        _check_space(target.parent, contents)
        partial = target.with_name(f".{target.name}.assembling")
        try:
            with replacing(target, durable=False, partial=partial), h5py.File(partial, "w") as file:
                _write(file, log, contents, indices)
        except OSError as error:
            raise RecordingError(
                "the recording could not be finished",
                got=error,
                where=path,
                remedy="free some space and open it again; nothing is lost",
            ) from error


def _read_contents(log: BinaryIO, path: Path, *, check: bool) -> _Contents:
    frames = scan(log, check=check)
    first = next(frames, None)
    if first is None or first.meta.get("kind") != "start":
        raise RecordingError(
            "the recording was stopped before it began", where=path, remedy="delete it and record again"
        )
    cameras = cast("dict[str, Json]", first.meta["cameras"])
    contents = _Contents(first.meta, {name: [] for name in cameras}, end=first.offset)
    for frame in frames:
        contents.end = frame.offset + frame.size
        match frame.meta["kind"]:
            case "events":
                _place_block(contents.blocks[cast(str, frame.meta["camera"])], frame)
            case "rows":
                contents.rows.setdefault(cast(str, frame.meta["group"]), []).append(frame)
            case "note":
                contents.notes.append(cast(str, frame.meta["text"]))
            case "duration":
                contents.duration_us = cast(int, frame.meta["duration_us"])
    return contents


def _place_block(blocks: list[tuple[int, int, tuple[int, ...]]], frame: Frame) -> None:
    sizes = tuple(cast("list[int]", frame.meta["sizes"]))
    block = (cast(int, frame.meta["count"]), frame.offset, sizes)
    number = cast(int, frame.meta["start"]) // CHUNK_EVENTS
    if number < len(blocks):  # the same block, longer now
        blocks[number] = block
    else:
        blocks.append(block)


def _index(log: BinaryIO, blocks: list[tuple[int, int, tuple[int, ...]]]) -> NDArray[np.uint64]:
    index = MsIndex()
    for count, offset, sizes in blocks:
        log.seek(offset)
        index.extend(unpack_column(log.read(sizes[0]), np.int64, (CHUNK_EVENTS,))[:count])
    return index.marks()


def _recovery_note(contents: _Contents, size: int) -> str:
    events = sum(count for blocks in contents.blocks.values() for count, _, _ in blocks)
    cut = size - contents.end
    tail = f"; {cut} bytes of an unfinished block at the end were dropped" if cut > 0 else ""
    return f"Its writer was stopped before it closed the recording: {events:,} events were recovered{tail}."


def _check_space(folder: Path, contents: _Contents) -> None:
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


def _write(file: h5py.File, log: BinaryIO, contents: _Contents, indices: Mapping[str, NDArray[np.uint64]]) -> None:
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
        camera.create_dataset(
            "ms_to_idx",
            data=marks,
            **({"compression": "gzip", "compression_opts": 1, "shuffle": True} if len(marks) else {}),
        )
        duration_us = max(duration_us, _write_events(file, log, name, contents.blocks[name]))
        for key, values in calibration.get(name, {}).items():
            file.create_dataset(f"{layout.calibration_group(name)}/{key}", data=np.array(values, np.float64))
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


def _write_events(file: h5py.File, log: BinaryIO, camera: str, blocks: list[tuple[int, int, tuple[int, ...]]]) -> int:
    """Copy the packed blocks into the datasets; returns the time just after the last event."""
    total = sum(count for count, _, _ in blocks)
    datasets = [
        _create_column(file, f"{layout.events_group(camera)}/{name}", (total,), np.dtype(dtype), (CHUNK_EVENTS,))
        for name, dtype in _COLUMNS
    ]
    for number, (_, offset, sizes) in enumerate(blocks):
        log.seek(offset)
        for dataset, size in zip(datasets, sizes, strict=True):
            dataset.id.write_direct_chunk((number * CHUNK_EVENTS,), log.read(size))
    if not blocks:
        return 0
    count, offset, sizes = blocks[-1]
    log.seek(offset)
    return int(unpack_column(log.read(sizes[0]), np.int64, (CHUNK_EVENTS,))[count - 1]) + 1


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
