"""AEDAT 3: several cameras in one file, external edges, and a file that ends within a packet."""

import struct
from itertools import zip_longest

import numpy as np
import pytest

from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport
from tests.strangers.event_files import Rows, aedat3_head, aedat3_packets, draw_rows

LEFT, RIGHT = draw_rows(346, 260), draw_rows(240, 180, count=900, seed=4)


def read(source) -> tuple[Rows, DecodeReport]:
    report = DecodeReport()
    parts = list(source.read(report))
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t_us", "x_px", "y_px", "on"))
    return Rows(*columns), report


@pytest.mark.parametrize("cameras", [(b"DAVIS346", b"DAVIS240C"), (b"DAVIS346",)], ids=["named", "one of them named"])
def test_every_camera_of_the_file_is_one_of_its_own(tmp_path, cameras):
    path = tmp_path / "two.aedat"
    packets = zip_longest(aedat3_packets(LEFT), aedat3_packets(RIGHT, source=2), fillvalue=b"")
    path.write_bytes(aedat3_head(*cameras) + b"".join(part for both in packets for part in both))
    sources = open_sources(path)
    assert [source.name for source in sources] == ["camera1", "camera2"]
    sizes = [str(source.sensor) for source in sources]
    assert sizes == ["346x260", "240x180"] if len(cameras) > 1 else sizes[0] == "346x260"
    for source, rows in zip(sources, (LEFT, RIGHT), strict=True):
        found, report = read(source)
        np.testing.assert_array_equal(np.array(found), np.array(rows))
        assert not report.left_out


@pytest.mark.parametrize("source", [1, 2])
def test_external_edges_of_whatever_source_belong_to_the_only_camera(tmp_path, source):
    path = tmp_path / "edges.aedat"
    edges = struct.pack("<hhiiiiii", 0, source, 8, 4, 0, 2, 2, 2) + struct.pack("<4I", 2 << 1 | 1, 10, 3 << 1 | 1, 25)
    path.write_bytes(aedat3_head(b"DAVIS346") + edges + b"".join(aedat3_packets(LEFT)))
    found, report = read(open_sources(path)[0])
    assert len(found.t) == len(LEFT.t)
    (triggers,) = report.triggers
    assert triggers.t_us.tolist() == [10, 25] and triggers.rising.tolist() == [True, False]


@pytest.mark.parametrize("lost", [1, 7, 8, 20])
def test_what_a_cut_packet_lacks_is_said(tmp_path, lost):
    path = tmp_path / "cut.aedat"
    path.write_bytes((aedat3_head(b"DAVIS346") + b"".join(aedat3_packets(LEFT)))[:-lost])
    found, report = read(open_sources(path)[0])
    missing = -(-lost // 8)  # events of eight bytes, the last of which is not valid
    np.testing.assert_array_equal(found.t, LEFT.t[: len(LEFT.t) + 1 - missing])
    assert report.left_out == {"missing events": missing}
    assert f"its last packet is cut short and holds {201 - missing} of 201 events" in " ".join(report.notes)
