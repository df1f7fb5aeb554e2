"""Prophesee RAW files: EVT2, EVT2.1 and EVT3, decoded here; EVT4 in `evt4`.

faery reads them too (the tests compare the two), but it gives up a whole packet where a file is damaged, without saying
at which byte, and it builds records that have to be taken apart into columns again.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import Events, SensorSize
from core.foreign_tables import allowed_odd
from core.recordings.hdf5 import read_only
from core.recordings.sources.checking import (
    CUT_SHORT,
    DAMAGED_TIMES,
    RESERVED_WORDS,
    outside_note,
    refuse_many_outside,
    refuse_zeros,
)
from core.recordings.sources.checking import OUTSIDE as OUTSIDE_SENSOR
from core.recordings.sources.evt2 import (
    LATE,
    decode_evt2,
    decode_evt21,
    realigned_evt2,
    start_state_evt2,
    start_state_evt21,
)
from core.recordings.sources.evt3 import IGNORED, MAX_X, MAX_Y, OUTSIDE, RESERVED, decode_evt3, start_state
from core.recordings.sources.evt4 import VERSIONS as EVT4_VERSIONS
from core.recordings.sources.evt4 import open_evt4
from core.recordings.sources.evt_time import BAD_COLUMN, BAD_ROW, BAD_TIME, BAD_WORD, BLOCK_BYTES, Decoded
from core.recordings.sources.prophesee_header import (
    PropheseeHeader,
    note_two_sizes,
    read_prophesee_header,
    text_follows,
)
from core.recordings.sources.source import BINARY_FACTS, DecodeReport, EventSource, FactOrigin

_MOSTLY_OUTSIDE: Final = 0.1
"""With so many addresses outside beside damaged times, the words are not those of the format, or bytes are missing."""
_DAMAGE: Final = {
    BAD_WORD: "a word of unknown type",
    BAD_COLUMN: "a column outside the sensor",
    BAD_ROW: "a row outside the sensor",
    BAD_TIME: "the time jumps back or too far ahead",
}


@dataclass(frozen=True, slots=True)
class _Format:
    word: np.dtype
    start_state: Callable[[NDArray], NDArray]
    decode: Callable[..., tuple[int, int, int, int]]
    realigned: Callable[[bytes], tuple[bytes, int]] | None = None
    """Whole words again behind bytes that were lost or added, and how many bytes are left out for that."""


_FORMATS: Final = {
    "EVT2": _Format(np.dtype("<u4"), start_state_evt2, decode_evt2, realigned_evt2),
    "EVT2.1": _Format(np.dtype("<u8"), start_state_evt21, decode_evt21),
    "EVT3": _Format(np.dtype("<u2"), start_state, decode_evt3),
}


def open_prophesee_raw(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    """The one camera of a RAW file; `sensor` overrides what the header says.

    Raises:
        RecordingError: if the header tells neither version nor, without `sensor`, the sensor size.
    """
    header = read_prophesee_header(path)
    version, version_assumed = header.version, False
    if version is None and sensor is None and header.sensor == SensorSize(640, 480):
        version, version_assumed = "EVT2", True  # the first generation that wrote RAW files knew no other
    if version in EVT4_VERSIONS:
        return [open_evt4(path, header, sensor)]
    if version not in _FORMATS:
        raise RecordingError(
            "the RAW header names no version this reader knows",
            expected=" or ".join([*_FORMATS, "EVT4"]),
            got=version or "none",
            where=path,
        )
    origin = FactOrigin.CAMERA if sensor is None and header.sensor_by_camera else FactOrigin.FILE
    size_given = sensor is not None
    sensor = sensor or header.sensor
    if sensor is None:
        raise RecordingError(
            "the RAW header does not say how large the sensor is", where=path, remedy="give --width and --height"
        )
    if text_follows(path, header):  # every line of text decodes to some events
        raise RecordingError("no events could be read: text follows the header", where=path)
    chosen, size = version, sensor

    def read(report: DecodeReport) -> Iterator[Events]:
        if version_assumed:
            report.assume(f"{path.name} names no version of its words; EVT2 is assumed, by the size of its sensor.")
        if not size_given:
            note_two_sizes(header, path.name, report)
        return _decode(path, header, _FORMATS[chosen], size, report)

    label = f"Prophesee {version}"
    return [EventSource("camera", label, sensor, read, sensor_from=origin, facts=BINARY_FACTS)]


def _decode(
    path: Path, header: PropheseeHeader, kind: _Format, sensor: SensorSize, report: DecodeReport
) -> Iterator[Events]:
    state: NDArray | None = None
    done, events_read, stopped = header.size_bytes, 0, False
    displaced, over, size, zeros = 0, b"", kind.word.itemsize, True
    with path.open("rb") as file:
        end = os.fstat(file.fileno()).st_size
        file.seek(done)
        while not stopped and (data := file.read(BLOCK_BYTES)):
            zeros = zeros and not data.strip(b"\0")
            data = over + data
            # A lost byte would shift every word that follows.
            if kind.realigned is not None:
                data, bytes_out = kind.realigned(data)
                displaced += bytes_out
                done += bytes_out
            whole = len(data) // size * size
            words, over = np.frombuffer(data[:whole], kind.word), data[whole:]
            if header.word_swapped:
                words = (words >> np.uint64(32)) | (words << np.uint64(32))
            if state is None:
                state = kind.start_state(words)
            while len(words) and not stopped:
                events, used, damage = _decode_part(words, state, kind, sensor, report)
                events_read += len(events)
                if len(events):
                    yield events
                done += used * kind.word.itemsize
                report.share = done / end
                if damage:
                    report.notes.append(f"{path.name}: stopped at byte {done:,} of {end:,}: {_DAMAGE[damage]}.")
                    stopped = True
                words = words[used:]
    note = f"{path.name}: bytes were lost or added; {displaced} bytes there were left out."
    report.leave_out("bytes out of place", displaced, note)
    if done != end and not stopped:
        note = f"{path.name}: the last {end - done} bytes are not a whole word; the file was cut short."
        report.leave_out(CUT_SHORT, end - done, note)
    if zeros:
        refuse_zeros(end - header.size_bytes, path)
    if state is not None:
        _say_left_out(path, state, sensor, events_read, report, damaged=stopped)
    report.share = 1.0


def _say_left_out(
    path: Path, state: NDArray, sensor: SensorSize, read: int, report: DecodeReport, *, damaged: bool
) -> None:
    """Count what was left out; a sensor that is too small for many events is refused."""
    outside, largest = int(state[OUTSIDE]), (int(state[MAX_X]), int(state[MAX_Y]))
    reserved, ignored = int(state[RESERVED]), int(state[IGNORED])
    if ignored <= allowed_odd(read) and not damaged:  # else damage, and no wrong size
        refuse_many_outside(outside, outside + read, sensor, largest, path.name)
    elif outside > _MOSTLY_OUTSIDE * (outside + read):
        raise RecordingError(
            f"{outside:,} of {outside + read:,} events lie outside the {sensor} sensor, and {ignored:,} times are"
            " damaged: the words are not of the format that the header names, or bytes are missing",
            where=path,
        )
    report.leave_out(OUTSIDE_SENSOR, outside, outside_note(outside, sensor, largest, path.name))
    note = f"{path.name}: {reserved:,} words of reserved types (padding) were skipped."
    report.leave_out(RESERVED_WORDS, reserved, note)
    report.leave_out(DAMAGED_TIMES, ignored, f"{path.name}: {ignored} damaged time words were ignored.")
    late = int(state[LATE]) if len(state) > LATE else 0
    note = f"{path.name}: {late:,} events came up to 1 ms too early; they have the time before them."
    report.change("time stepped back", late, note)


def _decode_part(
    words: NDArray, state: NDArray, kind: _Format, sensor: SensorSize, report: DecodeReport
) -> tuple[Events, int, int]:
    """The first events, as many as there is room for.

    With them the number of words used, and what is damaged behind them (0: nothing).
    """
    out = Decoded.empty()
    used, count, triggers, damage = kind.decode(words, state, sensor.width_px, sensor.height_px, out)
    report.add_triggers(out.trigger_t_us[:triggers], out.trigger_on[:triggers], out.trigger_id[:triggers])
    # the decoder has checked order and addresses
    t, x, y, on = (read_only(column[:count]) for column in (out.t_us, out.x_px, out.y_px, out.on))
    return Events(t, x, y, on, sensor), used, damage
