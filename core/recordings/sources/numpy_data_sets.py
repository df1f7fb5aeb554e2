"""NumPy files of data sets: N-ImageNet (event_data), EVIMO and EVIMO2 (one archive, or a folder of arrays).

event_data: records x, y, t in us, p                        N-ImageNet, 640x480
events (N, 4): t in s, x, y, p, with depth, mask, meta      EVIMO, EVIMO2 version 1
dataset_events_{t, xy, p}.npy in a folder, t in s           EVIMO2 version 2
The size of EVIMO's sensors is that of its depth maps and masks. What is pickled there (meta) is never loaded.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Final

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.making import make_table_source
from core.recordings.sources.numpy_files import BROKEN, in_parts
from core.recordings.sources.source import EventSource, RawColumns, Whence

_N_IMAGENET_SENSOR: Final = SensorSize(640, 480)
_PARTS: Final = ("dataset_events_t.npy", "dataset_events_xy.npy", "dataset_events_p.npy")
_PICTURES: Final = ("dataset_depth.npz", "dataset_mask.npz", "dataset_classical.npz")
_EVIMO_MEMBERS: Final = ("depth", "mask", "classical")
_FLIPPED: Final = "EVIMO2's Samsung camera counts ON and OFF the other way round than Prophesee's; kept as they are"


def open_numpy_data_set(path: Path, sensor: SensorSize | None) -> list[EventSource] | None:
    """The one camera of an archive of N-ImageNet or EVIMO; None for any other.

    Raises:
        RecordingError: if it is an archive of PyTorch, or its arrays are not those of the data set.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
    except BROKEN:
        return None
    if members and not any(name.endswith((".npy", ".pkl")) for name in members):
        files = [name for name in members if not name.endswith("/") and not name.startswith("__MACOSX")]
        got = ", ".join(files[:3]) + (", ..." if len(files) > 3 else "")
        raise RecordingError("a ZIP archive without NumPy arrays", got=got, where=path, remedy="unpack it first")
    if any(name.endswith("data.pkl") for name in members):
        raise pickled(path)
    names = {name.removesuffix(".npy") for name in members}
    try:
        if "event_data" in names:
            return [_open_n_imagenet(path, sensor)]
        if "events" in names and names & set(_EVIMO_MEMBERS):
            return [_open_evimo(path, sensor)]
    except BROKEN as error:
        raise RecordingError("the NumPy file cannot be read", got=error, where=path) from error
    return None


def pickled(path: Path) -> RecordingError:
    """What is said of a file that only runs of a pickle could open."""
    return RecordingError(
        "a pickled file is not opened: it could run any program",
        expected="an .npz or .npy of plain arrays",
        where=path,
        remedy="where you trust it, load it with its own tool and save the arrays: numpy.savez(F, t=t, x=x, y=y, p=p)",
    )


def is_evimo_folder(path: Path) -> bool:
    """Whether a folder holds the arrays of one EVIMO2 sequence."""
    return all((path / name).is_file() for name in _PARTS)


def open_evimo_folder(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of a folder of EVIMO2, version 2.

    Raises:
        RecordingError: if its arrays cannot be read or do not fit together.
    """
    try:
        t, xy, p = (np.load(path / name, mmap_mode="r", allow_pickle=False) for name in _PARTS)
        lengths = {name: len(array) for name, array in zip(_PARTS, (t, xy, p), strict=True)}
        if len(set(lengths.values())) != 1 or xy.ndim != 2 or xy.shape[1] != 2:
            raise RecordingError("event columns differ in shape", expected="equal lengths", got=lengths, where=path)
        size = sensor or _size_in(path)
    except BROKEN as error:
        raise RecordingError("the NumPy files cannot be read", got=error, where=path) from error
    columns = t.reshape(-1), xy[:, 0], xy[:, 1], p.reshape(-1)
    remark = f"{path.name}: {_FLIPPED}." if any("samsung" in part.lower() for part in path.parts) else None
    return [_source(path, "EVIMO2 NumPy", size, columns, remark, seconds=True)]


def _open_n_imagenet(path: Path, sensor: SensorSize | None) -> EventSource:
    with np.load(path, allow_pickle=False) as loaded:
        events = loaded["event_data"]
    if not {"x", "y", "t", "p"} <= set(events.dtype.names or ()):
        raise RecordingError("event_data has other fields", expected="x, y, t, p", got=events.dtype, where=path)
    columns = tuple(events[name].reshape(-1) for name in ("t", "x", "y", "p"))
    whence = Whence.DATA_SET if sensor is None else Whence.FILE
    size = sensor or _N_IMAGENET_SENSOR
    return _source(path, "N-ImageNet NumPy", size, columns, None, seconds=False, sensor_from=whence)


def _open_evimo(path: Path, sensor: SensorSize | None) -> EventSource:
    with np.load(path, allow_pickle=False) as loaded:
        events = loaded["events"]
    if events.ndim != 2 or events.shape[1] != 4 or events.dtype.kind not in "iuf":
        got = f"{events.dtype}{events.shape}"
        raise RecordingError("events are not EVIMO's", expected="(N, 4): t, x, y, p", got=got, where=path)
    columns = tuple(events[:, place] for place in range(4))
    remark = f"{path.name}: {_FLIPPED}." if any("samsung" in part.lower() for part in path.parts) else None
    return _source(path, "EVIMO NumPy", sensor or _stated_size(path, _EVIMO_MEMBERS), columns, remark, seconds=True)


def _source(
    path: Path,
    label: str,
    sensor: SensorSize | None,
    columns: tuple[NDArray, ...],
    remark: str | None,
    *,
    seconds: bool,
    sensor_from: Whence = Whence.FILE,
) -> EventSource:
    rows = RawColumns(*(np.asarray(column) for column in columns))
    unit = "us" if not seconds else "s" if rows.t.dtype.kind == "f" else None
    return make_table_source(
        path, "camera", label, sensor, lambda report: in_parts(rows, report),
        unit=unit, unit_from=Whence.FORMAT, sensor_from=sensor_from, assumed=() if remark is None else (remark,),
    )  # fmt: skip


def _size_in(folder: Path) -> SensorSize | None:
    found = (_stated_size(folder / name, None) for name in _PICTURES if (folder / name).is_file())
    return next((size for size in found if size is not None), None)


def _stated_size(path: Path, names: tuple[str, ...] | None) -> SensorSize | None:
    """Size of the pictures in an archive, from the header of the first such array."""
    with zipfile.ZipFile(path) as archive:
        for member in archive.namelist():
            if names is not None and member.removesuffix(".npy") not in names:
                continue
            with archive.open(member) as file:
                version = npy_format.read_magic(file)
                read_header = (
                    npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
                )
                shape = read_header(file)[0]
            if len(shape) in (2, 3) and all(shape):
                return SensorSize(int(shape[-1]), int(shape[-2]))
    return None
