"""AEDAT 2.0 and 1.0, written here bit by bit."""

from __future__ import annotations

import struct

import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport

DVS128 = "#!AER-DAT2.0\r\n# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n#End Of ASCII Header\r\n"
DAVIS346 = "#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346B\r\n#End Of ASCII Header\r\n"


def write(path, header, pairs, kind=">II"):
    path.write_bytes(header.encode() + b"".join(struct.pack(kind, address, t & 0xFFFFFFFF) for address, t in pairs))
    return path


def read(path, sensor=None):
    (source,) = open_sources(path, sensor)
    report = DecodeReport()
    events = concatenate_events(list(source.read(report)), source.sensor)
    columns = (events.t_us, events.x_px, events.y_px, events.on)
    return list(zip(*(column.tolist() for column in columns), strict=True)), report, source


def dvs128(x, y, on):
    """Column from the left, row from the top."""
    return (127 - y) << 8 | (127 - x) << 1 | (0 if on else 1)


def davis(x, y, on, width=346, height=260):
    return (height - 1 - y) << 22 | (width - 1 - x) << 12 | int(on) << 11


def test_a_dvs128_file_of_jaer_has_its_columns_rows_and_polarities(tmp_path):
    pairs = [(dvs128(0, 0, True), 100), (dvs128(127, 3, False), 101), (0x8000, 150), (dvs128(5, 127, True), 200)]
    rows, report, source = read(write(tmp_path / "a.aedat", DVS128, pairs))
    assert rows == [(100, 0, 0, True), (101, 127, 3, False), (200, 5, 127, True)]
    assert (source.format, source.sensor) == ("AEDAT 2.0, DVS128", SensorSize(128, 128))
    assert report.triggers[0].t_us.tolist() == [150]
    assert "bit 0 of an address is OFF, as in jAER" in report.notes[0]


def test_a_davis_file_leaves_out_samples_of_pictures_and_keeps_edges(tmp_path):
    pairs = [
        (davis(345, 0, True), 100),
        (1 << 31 | 77 << 22 | 5 << 12 | 600, 101),
        (1 << 10 | 3, 102),
        (1 << 10 | 2, 103),
        (davis(0, 259, False), 104),
    ]
    rows, report, source = read(write(tmp_path / "a.aedat", DAVIS346, pairs))
    assert rows == [(100, 345, 0, True), (104, 0, 259, False)]
    assert (source.format, str(source.sensor)) == ("AEDAT 2.0, DAVIS346", "346x260")
    assert (report.triggers[0].t_us.tolist(), report.triggers[0].rising.tolist()) == ([102, 103], [True, False])
    assert report.notes == ["a.aedat: 1 samples of pictures and of the IMU were left out."]


def test_times_of_32_bits_go_on_after_they_wrap(tmp_path):
    pairs = [(davis(1, 2, True), 2**32 - 5), (davis(3, 4, True), 2**32 + 7), (davis(3, 4, True), 2**32 + 9)]
    rows, _, _ = read(write(tmp_path / "a.aedat", DAVIS346, pairs))
    assert [row[0] for row in rows] == [2**32 - 5, 2**32 + 7, 2**32 + 9]


def test_a_file_that_does_not_name_its_camera_needs_its_size(tmp_path):
    header = "#!AER-DAT2.0\r\n# created by v2e\r\n# Timestamps tick is 1 us\r\n"
    path = write(tmp_path / "v2e.aedat", header, [(davis(9, 8, True), 5)])
    with pytest.raises(RecordingError, match=r"does not name the camera \(AEChip\); give --width and --height"):
        open_sources(path)
    rows, report, _ = read(path, SensorSize(346, 260))
    assert rows == [(5, 9, 8, True)]
    assert report.notes == ["v2e.aedat does not name its camera; by its size it is taken for a DAVIS346."]
    with pytest.raises(RecordingError, match="no camera of this size is known"):
        open_sources(path, SensorSize(640, 480))


def test_other_cameras_and_a_size_that_contradicts_are_refused(tmp_path):
    path = write(tmp_path / "a.aedat", DVS128.replace("DVS128", "DVS320"), [(1, 2)])
    with pytest.raises(RecordingError, match=r"the addresses of this camera are not known; .* got ch.*DVS320"):
        open_sources(path)
    path = write(tmp_path / "b.aedat", DVS128, [(1, 2)])
    with pytest.raises(RecordingError, match="the size contradicts the header; got 346x260 for a DVS128 of 128x128"):
        open_sources(path, SensorSize(346, 260))


def test_version_1_has_addresses_of_16_bits(tmp_path):
    header = "#!AER-DAT1.0\r\n# AEChip: ch.unizh.ini.jaer.chip.retina.DVS128\r\n"
    rows, _, source = read(write(tmp_path / "a.dat", header, [(dvs128(7, 9, False), 1234)], kind=">HI"))
    assert rows == [(1234, 7, 9, False)]
    assert source.format == "AEDAT 1.0, DVS128"
