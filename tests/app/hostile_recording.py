"""A recording whose cameras' names and notes want to be more than text."""

from pathlib import Path

import h5py
import numpy as np

from core.events import Events, SensorSize
from core.recordings import RecordingWriter

HOSTILE = (
    "<script>window.__pwned=1</script><img src=x onerror=window.__pwned=1>'\" onload='x"
    "\x1b[2J\x1b]0;title\x07\r\n\u202egpj.exe\u2066\x9b31m\\..\\"
)


def write_hostile_recording(path: Path) -> None:
    """5 ms of two cameras, the first one of which has such a name."""
    sensor = SensorSize(64, 48)
    with RecordingWriter(path, {"left": sensor, "right": sensor}) as writer:
        rows = np.arange(500)
        for name in ("left", "right"):
            writer.append(name, Events.from_columns(rows * 10, rows % 64, rows % 48, rows % 2, sensor))
        writer.note("plain")
    with h5py.File(path, "a") as file:
        name = HOSTILE.replace("/", "|").replace("\x00", "")
        file.move("cameras/left", f"cameras/{name}")
        file["cameras"].attrs["order"] = [name, "right"]
        file.attrs["notes"] = [HOSTILE, "B" * 20_000]
