"""Small event files as other tools write them: the bytes of each format, made here from columns of events."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat


class Rows(NamedTuple):
    """Columns of events as they are meant: times in us from the first, polarity 0 or 1."""

    t: NDArray[np.int64]
    x: NDArray[np.int64]
    y: NDArray[np.int64]
    p: NDArray[np.int64]

    def without(self, *rows: int) -> Rows:
        """The same events but for some."""
        return Rows(*(np.delete(column, rows) for column in self))

    def with_row(self, at: int, t: int, x: int, y: int, p: int) -> Rows:
        """With one more in front of row `at`."""
        return Rows(*(np.insert(column, at, value) for column, value in zip(self, (t, x, y, p), strict=True)))


def draw_rows(width: int, height: int, *, count: int = 2000, span_us: int = 500_000, seed: int = 3) -> Rows:
    """Random events in the order of their times, all of them different; the first is at 0."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.choice(span_us, count, replace=False)).astype(np.int64)
    x, y, p = rng.integers(0, width, count), rng.integers(0, height, count), rng.integers(0, 2, count)
    return Rows(t - t[0], x, y, p)


def write(path: Path, *parts: bytes) -> Path:
    """A file of these bytes."""
    path.write_bytes(b"".join(parts))
    return path


def text(path: Path, rows: Rows, form: str, *head: str, encoding: str = "utf-8", newline: str = "\n") -> Path:
    """A line for each event, `form` with t, s (seconds), x, y, p."""
    events = zip(*(column.tolist() for column in rows), strict=True)
    lines = [form.format(t=t, s=f"{t / 1e6:.6f}", x=x, y=y, p=p) for t, x, y, p in events]
    return write(path, newline.join([*head, *lines, ""]).encode(encoding))


def hdf5(path: Path, items: dict[str, object], **attributes: object) -> Path:
    """Datasets by their paths, and attributes of the file."""
    with h5py.File(path, "w") as file:
        for name, value in items.items():
            file[name] = value
        file.attrs.update(attributes)
    return path


def npz(path: Path, **arrays: object) -> Path:
    """An archive of NumPy arrays."""
    with path.open("wb") as file:
        np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
    return path


def npy(path: Path, array: NDArray) -> Path:
    """One NumPy array."""
    with path.open("wb") as file:
        np.save(file, array)
    return path


def dat(rows: Rows, head: bytes, *, kind: int = 0x0C, old: bool = False) -> bytes:
    """Prophesee DAT; `old` is the layout of version 1."""
    t, x, y, p = rows
    address = x | y << 9 | p << 17 if old else x | y << 14 | p << 28
    return head + bytes([kind, 8]) + np.stack([t % (1 << 32), address], 1).astype("<u4").tobytes()


def evt_words(rows: Rows, kind: str, extra: dict[int, list[int]] | None = None) -> NDArray[np.uint64]:
    """Words of EVT2, EVT2.1, EVT3 or EVT4, with some more in front of the events that `extra` names."""
    words: list[int] = []
    high = low = row = -1
    shift = 12 if kind == "evt3" else 6
    for k, (t, x, y, p) in enumerate(zip(*(c.tolist() for c in rows), strict=True)):
        if t >> shift != high:
            high, low = t >> shift, -1
            words.append(coarse_time(kind, high))
        words.extend((extra or {}).get(k, ()))
        if kind == "evt3":
            if t & 0xFFF != low:
                low = t & 0xFFF
                words.append(0x6000 | low)
            if y != row:
                row = y
                words.append(y)
            words.append(0x2000 | p << 11 | x)
        elif kind == "evt2.1":
            words.append(p << 60 | (t & 63) << 54 | x // 32 * 32 << 43 | y << 32 | 1 << x % 32)
        else:
            words.append((p if kind == "evt2" else 10 + p) << 28 | (t & 63) << 22 | x << 11 | y)
    return np.array(words, np.uint64)


def coarse_time(kind: str, value: int) -> int:
    """The word of a coarse time."""
    if kind == "evt3":
        return 0x8000 | value & 0xFFF
    value &= 0xFFFFFFF
    return {"evt2": 8 << 28 | value, "evt2.1": 8 << 60 | value << 32, "evt4": 14 << 28 | value}[kind]


def raw(rows: Rows, kind: str, head: bytes, extra: dict[int, list[int]] | None = None) -> bytes:
    """Prophesee RAW: a header and words."""
    size = {"evt2": "<u4", "evt2.1": "<u8", "evt3": "<u2", "evt4": "<u4"}[kind]
    return head + evt_words(rows, kind, extra).astype(size).tobytes()


def aedat2(rows: Rows, chip: bytes, width: int, height: int) -> bytes:
    """AEDAT 2.0 of a DAVIS."""
    address = (width - 1 - rows.x) << 12 | (height - 1 - rows.y) << 22 | rows.p << 11
    head = b"#!AER-DAT2.0\r\n# AEChip: " + chip + b"\r\n# End of ASCII Header\r\n"
    return head + np.stack([address, rows.t % (1 << 32)], 1).astype(">u4").tobytes()


def aedat3(rows: Rows, camera: bytes = b"DAVIS346", *, more: bytes = b"") -> bytes:
    """AEDAT 3.1 of one camera, with `more` before the last packet."""
    *packets, last = aedat3_packets(rows)
    return aedat3_head(camera) + b"".join([*packets, more, last])


def aedat3_head(*cameras: bytes) -> bytes:
    named = b"".join(b"#Source %d: %s\r\n" % (number, name) for number, name in enumerate(cameras, 1))
    return b"#!AER-DAT3.1\r\n#Format: RAW\r\n" + named + b"#!END-HEADER\r\n"


def aedat3_packets(rows: Rows, *, source: int = 1, part: int = 300) -> list[bytes]:
    """Of polarity events, one event in each that is not valid."""
    out = []
    for first in range(0, len(rows.t), part):
        t, x, y, p = (column[first : first + part].astype(np.int64) for column in rows)
        words = np.append(x << 17 | y << 2 | p << 1 | 1, 9 << 17)  # the last has no valid bit
        times = np.append(t, t[-1]) & 0x7FFFFFFF
        head = struct.pack("<hhiiiiii", 1, source, 8, 4, int(t[0] >> 31), len(words), len(words), len(words) - 1)
        out.append(head + np.stack([words, times], 1).astype("<u4").tobytes())
    return out


def mat5(path: Path, **variables: object) -> Path:
    """A MAT-file of version 5."""
    with path.open("wb") as file:
        savemat(file, variables)
    return path


def event_stream(rows: Rows, width: int, height: int) -> bytes:
    """Event Stream of a DVS; every event takes five bytes, and what passes between two takes one for 127 us."""
    out = bytearray(b"Event Stream\x02\x00\x00\x01" + struct.pack("<HH", width, height))
    now = 0
    for t, x, y, p in zip(*(c.tolist() for c in rows), strict=True):
        out += b"\xff" * ((t - now) // 127)
        out += struct.pack("<BHH", (t - now) % 127 << 1 | p, x, height - 1 - y)
        now = t
    return bytes(out)


def nmnist(rows: Rows) -> bytes:
    """40-bit events."""
    t, x, y, p = rows
    return np.stack([x, y, p << 7 | t >> 16, t >> 8 & 255, t & 255], 1).astype(np.uint8).tobytes()
