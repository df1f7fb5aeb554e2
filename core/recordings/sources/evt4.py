"""Prophesee EVT4: 32-bit words of one event, or pairs of words of up to 32 pixels of a row.

Source: the word layout of OpenEB (decoders/evt4). The type is in the upper four bits:
    A, B  an event, OFF or ON: time (6 bits), x (11), y (11)
    C, D  the same for up to 32 pixels from x on; the next word, whatever it looks like, is the mask of them
    E     the coarse time, 28 bits, in steps of 64 us
    9     an external trigger: time (6), unused (9), channel (5), count (7), value (1)
    6, 7  monitoring and what continues it;  F, or zeros  padding;  others are reserved
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import RecordingError
from core.events import SensorSize
from core.jit import njit
from core.recordings.sources.checking import CUT_SHORT, DAMAGED_TIMES, RESERVED_WORDS, check_stream, refuse_zeros
from core.recordings.sources.evt_time import BLOCK_BYTES, EVT4_TIME, IGNORE, Decoded, judge_time_high, next_time_high
from core.recordings.sources.making import make_source
from core.recordings.sources.prophesee_header import PropheseeHeader, note_two_sizes
from core.recordings.sources.source import Columns, DecodeReport, EventSource, FactOrigin

VERSIONS: Final = ("EVT4", "EVT4.0")
"""As headers spell it."""
OTHERS, CONTINUED, TRIGGER = 0x6, 0x7, 0x9
EVENT_OFF, EVENT_ON, VECTOR_OFF, VECTOR_ON, TIME_HIGH, PADDING = range(0xA, 0x10)

_HEAD_BYTES: Final = 64 << 10
_MAX_RESERVED: Final = 0.01
"""Largest share of reserved kinds among the first words: in a stream of this format there are none."""
_MASK: Final = EVT4_TIME.mask
HIGH, EPOCH, RESERVED, DAMAGED = range(4)


def open_evt4(path: Path, header: PropheseeHeader, sensor: SensorSize | None) -> EventSource:
    """The one camera of a RAW file of EVT4 words.

    Raises:
        RecordingError: if the size of the sensor is not told, or the words are of another format.
    """
    size = sensor or header.sensor
    if size is None:
        raise RecordingError(
            "the RAW header does not say how large the sensor is", where=path, remedy="give --width and --height"
        )
    with path.open("rb") as file:
        file.seek(header.size_bytes)
        head = file.read(_HEAD_BYTES)
    words = np.frombuffer(head[: len(head) - len(head) % 4], "<u4")
    # EVT4 has no magic number: its words are tried, as the header may lie.
    state = _start(words)
    _decode_words(words, state, Decoded.empty(32 * len(words) + 32, len(words) + 1))
    if state[RESERVED] > _MAX_RESERVED * max(1, len(words)):
        got = f"{state[RESERVED]:,} reserved words among the first {len(words):,}"
        raise RecordingError("the words are not those of EVT4, which the header names", got=got, where=path)
    origin = FactOrigin.CAMERA if sensor is None and header.sensor_by_camera else FactOrigin.FILE

    def decode(report: DecodeReport) -> Iterator[Columns]:
        if sensor is None:
            note_two_sizes(header, path.name, report)
        return _decode(path, header.size_bytes, report)

    return make_source(path, "camera", "Prophesee EVT4", size, decode, check_stream, sensor_from=origin)


def _start(words: NDArray[np.uint32]) -> NDArray[np.int64]:
    """The state in front of the first word: what stands before the first coarse time has that same time."""
    state = np.zeros(4, np.int64)
    first = int(next_time_high(words, 0, EVT4_TIME))
    state[HIGH] = first if first > 1 else 0
    return state


def _decode(path: Path, start: int, report: DecodeReport) -> Iterator[Columns]:
    rest, zeros = b"", True
    state: NDArray[np.int64] | None = None
    with path.open("rb") as file:
        end = os.fstat(file.fileno()).st_size
        done = file.seek(start)
        while data := file.read(BLOCK_BYTES):
            zeros = zeros and not data.strip(b"\0")
            done += len(data)
            data = rest + data
            words = np.frombuffer(data[: len(data) - len(data) % 4], "<u4")
            if state is None:
                state = _start(words)
            used, last = 0, 1
            while last and used < len(words):
                out = Decoded.empty()
                last, events, triggers = _decode_words(words[used:], state, out)
                used += last
                report.add_triggers(out.trigger_t_us[:triggers], out.trigger_on[:triggers], out.trigger_id[:triggers])
                yield Columns(out.t_us[:events], out.x_px[:events], out.y_px[:events], out.on[:events])
            # A vector whose mask is in the next block is read with it.
            rest = data[4 * used :]
            report.share = (done - start) / max(1, end - start)
    if zeros:
        refuse_zeros(end - start, path)
    note = f"{path.name}: the last {len(rest)} bytes are no whole event; the file was cut short."
    report.leave_out(CUT_SHORT, len(rest), note)
    if state is not None:
        reserved, damaged = int(state[RESERVED]), int(state[DAMAGED])
        report.leave_out(RESERVED_WORDS, reserved, f"{path.name}: {reserved:,} words of a reserved type were left out.")
        report.leave_out(DAMAGED_TIMES, damaged, f"{path.name}: {damaged:,} damaged time words were ignored.")


@njit
def _decode_words(words, state, out):
    """Fill `out`, a `Decoded`; returns (words used, events, triggers). A vector without its mask is not used."""
    t, x, y, on, trigger_t, trigger_on, trigger_id = out
    base = state[EPOCH] + (state[HIGH] << 6)
    events, triggers = 0, 0
    i = 0
    while i < len(words) and events <= len(t) - 32 and triggers < len(trigger_t):
        word = np.int64(words[i])
        kind = word >> 28
        if kind in (EVENT_OFF, EVENT_ON):
            t[events], on[events] = base + ((word >> 22) & 0x3F), kind & 1
            x[events], y[events] = (word >> 11) & 0x7FF, word & 0x7FF
            events += 1
        elif kind in (VECTOR_OFF, VECTOR_ON):
            if i + 1 == len(words):
                break
            i += 1
            mask = np.int64(words[i])
            for bit in range(32):
                if (mask >> bit) & 1:
                    t[events], on[events] = base + ((word >> 22) & 0x3F), kind & 1
                    x[events], y[events] = ((word >> 11) & 0x7FF) + bit, word & 0x7FF
                    events += 1
        elif kind == TIME_HIGH:
            value = word & _MASK
            if value != state[HIGH] and judge_time_high(words, i, value, state[HIGH], EVT4_TIME) == IGNORE:
                state[DAMAGED] += 1
            else:
                # The counter has 28 bits of 64 us: it begins again after 2^34 us.
                if state[HIGH] - value > _MASK // 2:
                    state[EPOCH] += 1 << 34
                state[HIGH] = value
                base = state[EPOCH] + (value << 6)
        elif kind == TRIGGER:
            trigger_t[triggers] = base + ((word >> 22) & 0x3F)
            trigger_on[triggers], trigger_id[triggers] = word & 1, (word >> 8) & 0x1F
            triggers += 1
        elif kind not in (OTHERS, CONTINUED, PADDING) and word:
            state[RESERVED] += 1
        i += 1
    return i, events, triggers
