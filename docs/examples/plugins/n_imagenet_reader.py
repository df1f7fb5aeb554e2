"""N-ImageNet (.npz): `rallyscope import n01440764_10026.npz DST.h5 --plugin n_imagenet_reader.py`.

The array event_data holds records x, y, t in us, p, of a sensor of 640x480.
"""

import zipfile
from pathlib import Path

import numpy as np

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources import EventSource, FactOrigin, RawColumns, make_table_source, register_reader
from core.recordings.sources.numpy_files import BROKEN, in_parts

SENSOR = SensorSize(640, 480)


def recognises(path: Path, head: bytes) -> bool:
    """Whether a file is an archive with the array event_data."""
    if not head.startswith(b"PK\x03\x04"):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            return "event_data.npy" in archive.namelist()
    except BROKEN:
        return False


def opens(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of the file."""
    try:
        with np.load(path, allow_pickle=False) as loaded:
            events = loaded["event_data"]
    except BROKEN as error:
        raise RecordingError("the NumPy file cannot be read", got=error, where=path) from error
    if not {"x", "y", "t", "p"} <= set(events.dtype.names or ()):
        raise RecordingError("event_data has other fields", expected="x, y, t, p", got=events.dtype, where=path)
    rows = RawColumns(*(events[name].reshape(-1) for name in ("t", "x", "y", "p")))
    origin = FactOrigin.DATA_SET if sensor is None else FactOrigin.FILE
    return [
        make_table_source(
            path, "camera", "N-ImageNet NumPy", sensor or SENSOR, lambda report: in_parts(rows, report),
            unit="us", unit_from=FactOrigin.FORMAT, sensor_from=origin,
        )
    ]  # fmt: skip


register_reader("n-imagenet", recognises, opens, "N-ImageNet", only_named=(".npz",))
