"""The ECF compression of Metavision HDF5 files: one chunk of events, decoded without the vendor's plug-in.

Written from the format (github.com/prophesee-ai/hdf5_ecf): a header (count << 2 | all packed << 1 | columns packed),
the first time, the times as run lengths, then rows, columns and polarities in one of three packings. Bounds are
checked at every step: -1 instead of a position means a damaged chunk.
"""

from __future__ import annotations

import numpy as np

from core.jit import njit
from core.recordings.sources.source import Columns


def decode_ecf(chunk: bytes) -> Columns:
    """The events of one chunk.

    Raises:
        ValueError: if it is damaged.
    """
    data = np.frombuffer(chunk, np.uint8)
    if len(data) < 12:
        raise ValueError("an ECF chunk is too short")
    header = int.from_bytes(chunk[:4], "little")
    # Bit 0: x and p are packed; bit 1: y, x and p are (prophesee-ai/hdf5_ecf).
    count = header >> 2
    if count > 65535:
        raise ValueError(f"an ECF chunk claims {count} events, more than the format allows")
    t = np.empty(count, np.int64)
    x, y, on = np.empty(count, np.uint16), np.empty(count, np.uint16), np.empty(count, np.bool_)
    at = _decode_times(data, 4, t)
    if at >= 0 and header & 2:
        at = _decode_packed(data, at, x, y, on)
    elif at >= 0:
        at = _decode_rows(data, at, y)
        if at >= 0 and header & 1:
            at = _decode_packed_columns(data, at, x, on)
        elif at >= 0:
            at = _decode_masked_columns(data, at, x)
            at = _decode_polarities(data, at, on) if at >= 0 else at
    if at < 0:
        raise ValueError("an ECF chunk ends before its events do")
    return Columns(t, x, y, on)


@njit
def _little(data, at, size):
    value = np.uint64(0)
    for i in range(size):
        value |= np.uint64(data[at + i]) << np.uint64(8 * i)
    return np.int64(value)


@njit
def _decode_times(data, at, t):
    """Bytes (step << 4 | count); count 15: it follows in 16 bits; step 15: four bits of a longer step, low first."""
    now = _little(data, at, 8)
    at += 8
    done, step, bits = 0, np.int64(0), 0
    while done < len(t):
        if at >= len(data):
            return -1
        upper, lower = np.int64(data[at] >> 4), np.int64(data[at] & 15)
        at += 1
        if upper == 15:
            if bits > 56:
                return -1
            step |= lower << bits
            bits += 4
            continue
        now += step + upper
        step, bits = np.int64(0), 0
        if lower == 15:
            if at + 2 > len(data):
                return -1
            lower = _little(data, at, 2)
            at += 2
        # No encoder writes a count of 0, and a damaged chunk of them would not end.
        if lower == 0 or done + lower > len(t):
            return -1
        t[done : done + lower] = now
        done += lower
    return at


@njit
def _decode_rows(data, at, y):
    """16-bit words (row << 5 | count); count 31: it follows in 16 bits."""
    done = 0
    while done < len(y):
        if at + 2 > len(data):
            return -1
        word = _little(data, at, 2)
        at += 2
        row, count = word >> 5, word & 31
        if count == 31:
            if at + 2 > len(data):
                return -1
            count = _little(data, at, 2)
            at += 2
        if count == 0 or done + count > len(y):
            return -1
        y[done : done + count] = row
        done += count
    return at


@njit
def _decode_masked_columns(data, at, x):
    """16-bit words (column << 5 | which of the next five columns follow, nearest first)."""
    done = 0
    while done < len(x):
        if at + 2 > len(data):
            return -1
        word = _little(data, at, 2)
        at += 2
        column = word >> 5
        x[done] = column
        done += 1
        for j in range(5):
            if (word >> (4 - j)) & 1 and done < len(x):
                x[done] = column + j + 1
                done += 1
    return at


@njit
def _decode_polarities(data, at, on):
    """Bytes (polarity << 7 | count); count 127: it follows in 16 bits."""
    done = 0
    while done < len(on):
        if at >= len(data):
            return -1
        polarity, count = data[at] >> 7, np.int64(data[at] & 127)
        at += 1
        if count == 127:
            if at + 2 > len(data):
                return -1
            count = _little(data, at, 2)
            at += 2
        if count == 0 or done + count > len(on):
            return -1
        on[done : done + count] = polarity == 1
        done += count
    return at


@njit
def _decode_packed_columns(data, at, x, on):
    """Four values (column << 1 | polarity) of 12 bits in three 16-bit words."""
    for first in range(0, len(x), 4):
        if at + 6 > len(data):
            return -1
        a, b, c = _little(data, at, 2), _little(data, at + 2, 2), _little(data, at + 4, 2)
        at += 6
        values = (a >> 4, (a & 0xF) | (b >> 8) << 4, (b & 0xFF) | (c >> 12) << 8, c & 0xFFF)
        for j in range(min(4, len(x) - first)):
            x[first + j] = values[j] >> 1
            on[first + j] = values[j] & 1
    return at


@njit
def _decode_packed(data, at, x, y, on):
    """Four values (row << 12 | column << 1 | polarity) of 24 bits in three 32-bit words."""
    for first in range(0, len(x), 4):
        if at + 12 > len(data):
            return -1
        a, b, c = _little(data, at, 4), _little(data, at + 4, 4), _little(data, at + 8, 4)
        at += 12
        values = (a >> 8, (a & 0xFF) | (b >> 16) << 8, (b & 0xFFFF) | (c >> 24) << 16, c & 0xFFFFFF)
        for j in range(min(4, len(x) - first)):
            y[first + j] = (values[j] >> 12) & 0x7FF
            x[first + j] = (values[j] >> 1) & 0x7FF
            on[first + j] = values[j] & 1
    return at
