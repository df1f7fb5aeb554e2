"""Metavision HDF5: the vendor's own compression, and without it."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from core.events import concatenate_events
from core.recordings.sources import open_sources
from core.recordings.sources.ecf import decode_ecf
from core.recordings.sources.source import DecodeReport

RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])


def read_all(path):
    (source,) = open_sources(path)
    report = DecodeReport()
    return concatenate_events(list(source.read(report)), source.sensor), report, source


def test_the_real_ecf_file_equals_its_raw_twin_event_for_event(shared_events):
    events, report, source = read_all(shared_events / "walker_metavision_ecf.hdf5")
    twin, _, _ = read_all(shared_events / "walker_evt3_640x480.raw")
    assert source.format == "Metavision HDF5, ECF"
    assert len(events) == 343_474
    for name in ("t_us", "x_px", "y_px", "on"):
        np.testing.assert_array_equal(getattr(events, name), getattr(twin, name))
    assert report.notes == []


def runs(values):
    """(value, how often) of neighbours that are equal."""
    edges = np.flatnonzero(np.diff(values)) + 1
    return [(int(part[0]), len(part)) for part in np.split(values, edges)]


def encode_ecf(t, x, y, p, packing: str) -> bytes:
    """An ECF chunk after the format, in the packing "all", "columns" or "masks"."""
    n = len(t)
    out = bytearray((n << 2 | (packing == "all") << 1 | (packing == "columns")).to_bytes(4, "little"))
    out += int(t[0]).to_bytes(8, "little")
    now = int(t[0])
    for value, count in runs(t):
        step, now = value - now, value
        if step >= 15:
            while step:
                out.append(0xF0 | step & 15)
                step >>= 4
        out += bytes([step << 4 | min(count, 15)]) + (count.to_bytes(2, "little") if count >= 15 else b"")
    if packing == "all":
        out += _pack([(int(b) << 12 | int(a) << 1 | int(c)) for a, b, c in zip(x, y, p, strict=True)], 24)
        return bytes(out)
    for value, count in runs(y):
        word = value << 5 | min(count, 31)
        out += word.to_bytes(2, "little") + (count.to_bytes(2, "little") if count >= 31 else b"")
    if packing == "columns":
        out += _pack([(int(a) << 1 | int(c)) for a, c in zip(x, p, strict=True)], 12)
        return bytes(out)
    i = 0
    while i < n:
        base, mask = int(x[i]), 0
        i += 1
        for j in range(1, 6):
            if i < n and int(x[i]) == base + j:
                mask |= 1 << (5 - j)
                i += 1
        out += (base << 5 | mask).to_bytes(2, "little")
    for value, count in runs(p):
        out += bytes([value << 7 | min(count, 127)]) + (count.to_bytes(2, "little") if count >= 127 else b"")
    return bytes(out)


def _pack(values: list[int], bits: int) -> bytes:
    """Four values in three words: each word is the rest of one value and, below it, the low bits of the next."""
    values = values + [0] * (-len(values) % 4)
    third = bits // 3
    out = b""
    for i in range(0, len(values), 4):
        for k in range(3):
            shift = third * (k + 1)
            word = (values[i + k] >> third * k) << shift | values[i + k + 1] & ((1 << shift) - 1)
            out += word.to_bytes(third // 2, "little")
    return out


def chunk_columns(seed: int, count: int):
    """Runs of every length, large and small steps of time, neighbouring columns."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(np.repeat(rng.choice([0, 1, 14, 15, 16, 300, 70_000], count), 1) * (rng.random(count) < 0.3))
    y = np.repeat(rng.integers(0, 720, count), rng.integers(1, 80, count))[:count]
    x = np.repeat(rng.integers(0, 1270, count), 3)[:count] + np.tile([0, 1, 4], count)[:count]
    p = np.repeat(rng.integers(0, 2, count), rng.integers(1, 300, count))[:count]
    return t + 10**12, x, y, p


@pytest.mark.parametrize("packing", ["all", "columns", "masks"])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 4096, 16384])
def test_each_packing_of_ecf_is_decoded(packing, count):
    t, x, y, p = chunk_columns(count, count)
    decoded = decode_ecf(encode_ecf(t, x, y, p, packing))
    np.testing.assert_array_equal(decoded.t_us, t)
    np.testing.assert_array_equal(decoded.x_px, x)
    np.testing.assert_array_equal(decoded.y_px, y)
    np.testing.assert_array_equal(decoded.on, p == 1)


@pytest.mark.parametrize("packing", ["all", "columns", "masks"])
def test_a_damaged_ecf_chunk_is_an_error_or_other_events_but_never_a_crash(packing):
    chunk = encode_ecf(*chunk_columns(1, 500), packing)
    rng = np.random.default_rng(2)
    refused = 0
    for length in rng.integers(0, len(chunk) - 12, 40).tolist():
        with pytest.raises(ValueError, match="ECF chunk"):
            decode_ecf(chunk[:length])
    for _ in range(200):
        damaged = bytearray(chunk)
        damaged[rng.integers(len(chunk))] ^= int(rng.integers(1, 256))
        try:
            decode_ecf(bytes(damaged))
        except ValueError:
            refused += 1
    assert refused > 0


def test_plain_records_with_triggers_and_no_geometry(tmp_path):
    records = np.zeros(1000, RECORD)
    records["t"], records["x"], records["y"] = np.arange(1000) * 7 + 50, np.arange(1000) % 300, np.arange(1000) % 200
    triggers = np.array([(1, 60, 0), (0, 90, 3)], [("p", "<i2"), ("t", "<i8"), ("id", "<i2")])
    path = tmp_path / "a.hdf5"
    with h5py.File(path, "w") as file:
        file.create_dataset("CD/events", data=records, chunks=(300,), compression="gzip")
        file["EXT_TRIGGER/events"] = triggers
    events, report, source = read_all(path)
    np.testing.assert_array_equal(events.t_us, records["t"])
    assert str(source.sensor) == "304x240"
    assert report.notes == [
        "a.hdf5 does not name its sensor size; 304x240 is assumed from the events.",
        "a.hdf5: all polarities are alike: 0 = OFF.",
    ]
    assert report.triggers[0].t_us.tolist() == [60, 90]
    assert report.triggers[0].channel.tolist() == [0, 3]
    assert report.triggers[0].rising.tolist() == [True, False]
