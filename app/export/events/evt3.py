"""Prophesee RAW with EVT3 words, a file per camera, as the vendor's tools read them.

Source: Prophesee's EVT3 format description. Single events only (no vectors): a word per event, and one for each change
of row and time. The coarse time is repeated every 4,096 us, as cameras do, so that its wrapping can be followed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.export.events.event_slices import check_cameras, event_slices, share_of
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, unfinished_folder
from core.errors import CommandError
from core.events import Events, SensorSize
from core.jit import njit
from core.recordings import CameraStream, Recording

LARGEST_PX: Final = 2048
"""Addresses have 11 bits."""
LOW_BITS: Final = 12
ROW, COLUMN, TIME_LOW, TIME_HIGH = 0x0000, 0x2000, 0x6000, 0x8000
NONE: Final = -1


def export_evt3(
    recording: Recording,
    folder: Path,
    span: Span,
    *,
    overwrite: bool = False,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> tuple[Path, ...]:
    """Write `<camera>.raw` for every camera; times count from the span's start.

    Raises:
        CommandError: if a file exists, cannot be written, or a sensor is too large.
        ExportCancelledError: if `cancelled` said so; nothing is written then.
    """
    names = check_cameras(recording)
    for name in names:
        sensor = recording.cameras[name].sensor
        if max(sensor.width_px, sensor.height_px) > LARGEST_PX:
            raise CommandError("too large a sensor for EVT3", expected=f"up to {LARGEST_PX}", got=sensor, where=name)
    with unfinished_folder(folder, [f"{name}.raw" for name in names], overwrite=overwrite) as unfinished:
        for number, name in enumerate(names):
            share = share_of(number, len(names), progress)
            _write_camera(recording.cameras[name], unfinished / f"{name}.raw", span, share, cancelled)
    return tuple(folder / f"{name}.raw" for name in names)


class Evt3Encoder:
    """Events to words; what the reader remembers is remembered here from slice to slice."""

    def __init__(self) -> None:
        self._state = np.full(3, NONE, np.int64)

    def encode(self, events: Events) -> NDArray[np.uint16]:
        """The words of the next events, whose times continue those before."""
        if not len(events):
            return np.zeros(0, np.uint16)
        highs = int(events.t_us[-1] >> LOW_BITS) - int(self._state[0])
        words = np.empty(3 * len(events) + highs, np.uint16)
        count = _encode(events.t_us, events.x_px, events.y_px, events.on, self._state, words)
        return words[:count]


def header(sensor: SensorSize) -> bytes:
    """The text in front of the words."""
    w, h = sensor.width_px, sensor.height_px
    lines = ["evt 3.0", f"format EVT3;height={h};width={w}", f"geometry {w}x{h}", "end"]
    return "".join(f"% {line}\n" for line in lines).encode()


def _write_camera(stream: CameraStream, path: Path, span: Span, progress: Progress, cancelled: Cancelled) -> None:
    encoder = Evt3Encoder()
    with path.open("wb") as file:
        file.write(header(stream.sensor))
        for events in event_slices(stream, span, progress, cancelled):
            file.write(encoder.encode(events).astype("<u2").tobytes())


@njit
def _encode(t, x, y, on, state, words):
    """Fill `words`, return how many; `state` is the last coarse time, fine time and row, -1 before there is one."""
    high, low, row = state[0], state[1], state[2]
    n = 0
    for i in range(len(t)):
        coarse, fine = t[i] >> 12, t[i] & 0xFFF
        while high < coarse:
            high += 1
            words[n] = TIME_HIGH | (high & 0xFFF)
            n += 1
            low = -1
        if fine != low:
            low = fine
            words[n] = TIME_LOW | low
            n += 1
        if y[i] != row:
            row = np.int64(y[i])
            words[n] = ROW | row
            n += 1
        words[n] = COLUMN | (np.int64(on[i]) << 11) | np.int64(x[i])
        n += 1
    state[0], state[1], state[2] = high, low, row
    return n
