"""EVIMO and EVIMO2: `rallyscope import SEQUENCE.npz|FOLDER DST.h5 --plugin evimo_reader.py`.

events (N, 4): t in s, x, y, p, with depth, mask, meta      EVIMO, EVIMO2 version 1
dataset_events_{t, xy, p}.npy in a folder, t in s           EVIMO2 version 2
The size of the sensor is that of the depth maps and masks. What is pickled there (meta) is never loaded.
"""

import zipfile
from pathlib import Path

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources import EventSource, FactOrigin, RawColumns, make_table_source, register_reader
from core.recordings.sources.numpy_files import BROKEN, in_parts

PARTS = ("dataset_events_t.npy", "dataset_events_xy.npy", "dataset_events_p.npy")
PICTURES = ("dataset_depth.npz", "dataset_mask.npz", "dataset_classical.npz")
MEMBERS = ("depth", "mask", "classical")
FLIPPED = "EVIMO2's Samsung camera counts ON and OFF the other way round than Prophesee's; kept as they are"


def recognises(path: Path, head: bytes) -> bool:
    """Whether it is a folder with the arrays of one sequence, or an archive of events and pictures."""
    if path.is_dir():
        return all((path / name).is_file() for name in PARTS)
    if not head.startswith(b"PK\x03\x04"):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            names = {name.removesuffix(".npy") for name in archive.namelist()}
    except BROKEN:
        return False
    return "events" in names and any(name in names for name in MEMBERS)


def opens(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the sequence."""
    try:
        if path.is_dir():
            return [open_folder(path, sensor)]
        with np.load(path, allow_pickle=False) as loaded:
            events = loaded["events"]
        if events.ndim != 2 or events.shape[1] != 4 or events.dtype.kind not in "iuf":
            got = f"{events.dtype}{events.shape}"
            raise RecordingError("events are not EVIMO's", expected="(N, 4): t, x, y, p", got=got, where=path)
        columns = tuple(events[:, place] for place in range(4))
        return [source(path, "EVIMO NumPy", sensor or stated_size(path, MEMBERS), columns)]
    except BROKEN as error:
        raise RecordingError("the NumPy file cannot be read", got=error, where=path) from error


def open_folder(path: Path, sensor: SensorSize | None) -> EventSource:
    """The camera of a folder of EVIMO2, version 2."""
    t, xy, p = (np.load(path / name, mmap_mode="r", allow_pickle=False) for name in PARTS)
    lengths = {name: len(array) for name, array in zip(PARTS, (t, xy, p), strict=True)}
    if len(set(lengths.values())) != 1 or xy.ndim != 2 or xy.shape[1] != 2:
        raise RecordingError("event columns differ in shape", expected="equal lengths", got=lengths, where=path)
    sizes = (stated_size(path / name, None) for name in PICTURES if (path / name).is_file())
    size = sensor or next((size for size in sizes if size is not None), None)
    return source(path, "EVIMO2 NumPy", size, (t.reshape(-1), xy[:, 0], xy[:, 1], p.reshape(-1)))


def source(path: Path, label: str, sensor: SensorSize | None, columns: tuple[NDArray, ...]) -> EventSource:
    """The camera with these columns t, x, y, p. Times that are whole numbers have another unit than seconds."""
    rows = RawColumns(*map(np.asarray, columns))
    samsung = any("samsung" in part.lower() for part in path.parts)
    return make_table_source(
        path, "camera", label, sensor, lambda report: in_parts(rows, report),
        unit="s" if rows.t.dtype.kind == "f" else None, unit_from=FactOrigin.FORMAT,
        assumed=(f"{path.name}: {FLIPPED}.",) if samsung else (),
    )  # fmt: skip


def stated_size(path: Path, names: tuple[str, ...] | None) -> SensorSize | None:
    """Size of the pictures in an archive, from the header of the first such array."""
    with zipfile.ZipFile(path) as archive:
        for member in archive.namelist():
            if names is not None and member.removesuffix(".npy") not in names:
                continue
            with archive.open(member) as file:
                first = npy_format.read_magic(file) == (1, 0)
                read = npy_format.read_array_header_1_0 if first else npy_format.read_array_header_2_0
                shape = read(file)[0]
            if len(shape) in (2, 3) and all(shape):
                return SensorSize(int(shape[-1]), int(shape[-2]))
    return None


register_reader("evimo", recognises, opens, "EVIMO", only_named=(".npz",), folders=True)
