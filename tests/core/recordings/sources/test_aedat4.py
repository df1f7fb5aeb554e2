"""AEDAT4: every event has the time that the file gives it, compressed or not, also where times step back."""

import struct

import numpy as np
import pyarrow
import pytest

from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport
from tests.strangers.event_files import Rows, draw_rows

ROWS = draw_rows(346, 260, count=2000)
STREAM = """<dv version="2.0"><node name="outInfo" path="/"><node name="0" path="/0/">
<attr key="compression" type="string">NONE</attr><attr key="typeIdentifier" type="string">EVTS</attr>
<node name="info" path="/0/info/"><attr key="sizeX" type="int">346</attr><attr key="sizeY" type="int">260</attr></node>
</node></node></dv>"""


def file_head() -> bytes:
    """A FlatBuffer of three fields: no compression, no table at the end of the file, and the description."""
    text = STREAM.encode() + b"\0" * (4 - len(STREAM) % 4)
    table = struct.pack("<I4sHHHHHHiiIq", 20, b"IOHE", 10, 20, 4, 12, 8, 0, 12, 0, 12, -1)
    body = table + struct.pack("<I", len(STREAM)) + text
    return b"#!AER-DAT4.0\r\n" + struct.pack("<I", len(body)) + body


def packet(rows: Rows, compression: str | None = None) -> bytes:
    """Events of stream 0: a FlatBuffer of one field, a vector of structs of 16 bytes."""
    events = np.zeros(len(rows.t), [("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("on", "u1"), ("padding", "V3")])
    events["t"], events["x"], events["y"], events["on"] = rows
    table = struct.pack("<I4sHHHHiIiI", 16, b"EVTS", 6, 8, 4, 0, 8, 8, 0, len(events))
    content = struct.pack("<I", len(table) + events.nbytes) + table + events.tobytes()
    if compression is not None:
        packed = pyarrow.BufferOutputStream()
        with pyarrow.CompressedOutputStream(packed, compression) as stream:
            stream.write(content)
        content = packed.getvalue().to_pybytes()
    return struct.pack("<ii", 0, len(content)) + content


def part(start: int, end: int, later_us: int = 0) -> Rows:
    """Some of the events, later."""
    t, x, y, on = (column[start:end] for column in ROWS)
    return Rows(t + later_us, x, y, on)


def read(path) -> tuple[Rows, DecodeReport]:
    (source,) = open_sources(path)
    assert str(source.sensor) == "346x260"
    report = DecodeReport()
    parts = list(source.read(report))
    columns = (np.concatenate([getattr(one, name) for one in parts]) for name in ("t_us", "x_px", "y_px", "on"))
    return Rows(*columns), report


@pytest.mark.parametrize("compression", [None, "lz4", "zstd"])
def test_packets_of_each_compression(tmp_path, compression):
    path = tmp_path / "a.aedat4"
    path.write_bytes(file_head() + b"".join(packet(part(at, at + 500), compression) for at in range(0, 2000, 500)))
    found, report = read(path)
    np.testing.assert_array_equal(np.array(found), np.array(ROWS))
    assert not report.notes and not report.left_out


def test_a_clock_that_starts_anew_ends_the_recording_instead_of_standing_still(tmp_path):
    path = tmp_path / "reset.aedat4"
    path.write_bytes(file_head() + packet(part(0, 1000, 3_600_000_000)) + packet(part(1000, 2000)))
    found, report = read(path)
    np.testing.assert_array_equal(found.t, ROWS.t[:1000] + 3_600_000_000)
    assert any("stopped at event 1,000: time runs" in note for note in report.notes)


def test_one_damaged_time_costs_one_event(tmp_path):
    path = tmp_path / "flipped.aedat4"
    packets = [part(at, at + 500) for at in range(0, 2000, 500)]
    packets[1].t[200] += 1 << 30
    path.write_bytes(file_head() + b"".join(map(packet, packets)))
    found, report = read(path)
    np.testing.assert_array_equal(found.t, np.delete(ROWS.t, 700))
    assert sum(report.left_out.values()) == 1


@pytest.mark.parametrize("at", [4, 8, 20, 24, 32])
def test_a_packet_whose_table_is_damaged_is_left_out_and_said(tmp_path, at):
    path = tmp_path / "damaged.aedat4"
    damaged = bytearray(packet(part(500, 1000)))
    damaged[8 + at : 12 + at] = b"\xff\xff\xff\x7f"
    path.write_bytes(file_head() + packet(part(0, 500)) + bytes(damaged) + packet(part(1000, 2000)))
    found, report = read(path)
    np.testing.assert_array_equal(found.t, np.delete(ROWS.t, slice(500, 1000)))
    assert any("damaged packets were left out" in note for note in report.notes)
