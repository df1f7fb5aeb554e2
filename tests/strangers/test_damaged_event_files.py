"""Event files that lost bytes, gained some, or have a broken packet: what is whole beside the damage is read."""

import struct

import faery
import numpy as np
import pytest

from core.errors import RecordingError
from core.recordings import open_recording
from tests.strangers import event_files as make
from tests.strangers.test_event_reports import BLUE, DAVIS, HEAD2, VGA, import_file, np_split


def test_the_parts_of_an_event_stream_behind_lost_bytes_keep_their_steps(tmp_path):
    data = make.event_stream(VGA, 640, 480)
    first, _, last = np_split(data, 500, b"")
    path = make.write(tmp_path / "a.es", first, last[3:])
    summary = import_file([path], tmp_path / "out.h5")
    assert "1 places are no events and were left out" in " | ".join(summary.notes)
    with open_recording(tmp_path / "out.h5") as recording:
        found = recording.cameras["camera"].slice(0, 10**9)
    np.testing.assert_array_equal(np.diff(found.t_us[-1400:]), np.diff(VGA.t[-1400:]))
    np.testing.assert_array_equal(found.y_px[-1400:], VGA.y[-1400:])


HEAD4 = b"% format EVT4;height=480;width=640\n% end\n"


@pytest.mark.parametrize("head", [HEAD2, HEAD4])
@pytest.mark.parametrize(("body", "said"), [(bytes(64), "all bytes behind the header are 0"), (b"", "")])
def test_a_raw_file_of_zeros_is_refused_and_one_without_a_word_is_noted(tmp_path, head, body, said):
    path = make.write(tmp_path / "a.raw", head, body)
    if said:
        with pytest.raises(RecordingError, match=said):
            import_file([path], tmp_path / "out.h5")
    else:
        assert "Camera camera has no events: a.raw holds none." in import_file([path], tmp_path / "out.h5").notes


def aedat4_packets(data: bytes) -> list[tuple[int, int]]:
    """Where the packets of an AEDAT4 file begin and end."""
    at = 18 + struct.unpack_from("<I", data, 14)[0]
    found = []
    while at + 8 <= len(data):
        track, size = struct.unpack_from("<ii", data, at)
        if not (0 <= track < 8 and 0 < size <= len(data) - at - 8):
            break
        found.append((at, at + 8 + size))
        at += 8 + size
    return found


@pytest.mark.parametrize(("place", "value", "axis"), [(8, 700, "700, "), (10, 481, ", 481")])
def test_one_address_outside_does_not_cost_its_packet_of_aedat4(tmp_path, place, value, axis):
    """SensorsINI/DHP19#8: faery gives up a whole packet for one event."""
    path = tmp_path / "a.aedat4"
    events = np.zeros(len(VGA.t), faery.EVENTS_DTYPE)
    events["t"], events["x"], events["y"], events["on"] = VGA.t, VGA.x, VGA.y, VGA.p == 1
    faery.events_stream_from_array(events, (640, 480)).to_file(path, zero_t0=False, compression=None)
    data = bytearray(path.read_bytes())
    row = data.find(struct.pack("<qhhB", *(int(column[900]) for column in VGA)))
    struct.pack_into("<h", data, row + place, value)
    make.write(path, bytes(data))
    summary = import_file([path], tmp_path / "out.h5")
    assert "1 events outside the 640x480 sensor were left out" in summary.notes[-1] and axis in summary.notes[-1]
    assert list(summary.events.values()) == [len(VGA.t) - 1]


@pytest.mark.parametrize("fault", ["content", "size", "lost bytes", "junk", "cut"])
def test_a_broken_packet_of_aedat4_costs_itself(tmp_path, fault):
    """neuromorphicsystems/aedat#20: one packet that is not understood ends the whole file elsewhere."""
    events = np.zeros(60_000, faery.EVENTS_DTYPE)
    events["t"], events["x"], events["y"] = np.arange(60_000) * 20, np.arange(60_000) % 640, np.arange(60_000) % 480
    whole = tmp_path / "whole.aedat4"
    faery.events_stream_from_array(events, (640, 480)).to_file(whole, zero_t0=False)
    data = whole.read_bytes()
    packets = aedat4_packets(data)
    assert len(packets) > 4
    start, end = packets[2]
    middle = (start + end) // 2
    path = make.write(tmp_path / "a.aedat4", *{
        "content": (data[: start + 20], b"\xff" * 200, data[start + 220 :]),
        "size": (data[: start + 4], b"\xff\xff\xff\xff", data[start + 8 :]),
        "lost bytes": (data[:middle], data[middle + 50 :]),
        "junk": (data[:start], b"\xab" * 999, data[start:]),
        "cut": (data[: packets[-1][0] + 30],),
    }[fault])  # fmt: skip
    import_file([whole], tmp_path / "whole.h5")
    summary = import_file([path], tmp_path / "out.h5")
    assert "damaged packets were left out" in " | ".join(summary.notes)
    per_packet = len(events) // len(packets) + 1
    with open_recording(tmp_path / "out.h5") as recording:
        found = recording.cameras["camera"].slice(0, 10**9)
    lost = len(events) - len(found)
    assert lost <= 2 * per_packet and (fault == "junk") == (lost == 0)
    kept = np.isin(events["t"], found.t_us)
    np.testing.assert_array_equal(found.t_us, events["t"][kept])
    np.testing.assert_array_equal(found.x_px, events["x"][kept])


@pytest.mark.parametrize("rows_at_once", [1 << 17, 300])
@pytest.mark.parametrize(("lost", "added"), [(1, 0), (2, 0), (3, 0), (4, 0), (7, 0), (0, 1), (0, 5), (0, 64)])
def test_lost_or_added_bytes_of_aedat2_cost_what_stands_there(tmp_path, monkeypatch, lost, added, rows_at_once):
    monkeypatch.setattr("core.recordings.sources.aedat2._ROWS", rows_at_once)
    data, at = make.aedat2(DAVIS, BLUE, 346, 260), 8 * 1001
    noise = np.random.default_rng(5).integers(0, 256, added, np.uint8).tobytes()
    path = make.write(tmp_path / "a.aedat", data[:-at], noise, data[len(data) - at + lost :])
    summary = import_file([path], tmp_path / "a.h5")
    with open_recording(tmp_path / "a.h5") as recording:
        (camera,) = recording.cameras.values()
        events = camera.slice(0, recording.duration_us)
    meant = set(zip(DAVIS.t.tolist(), DAVIS.x.tolist(), DAVIS.y.tolist(), DAVIS.p.tolist(), strict=True))
    t = events.t_us + int(DAVIS.t[0])
    found = set(
        zip(t.tolist(), events.x_px.tolist(), events.y_px.tolist(), events.on.astype(int).tolist(), strict=True)
    )
    assert not found - meant and len(found) >= len(meant) - 2
    assert any("bytes were lost or added" in note for note in summary.notes)


@pytest.mark.parametrize(("lost", "added"), [(1, 0), (2, 0), (0, 2), (0, 3)])
def test_lost_or_added_bytes_of_evt2_cost_what_stands_there(tmp_path, lost, added):
    data, at = make.raw(VGA, "evt2", HEAD2), 4 * 1501 - 1
    path = make.write(tmp_path / "a.raw", data[:-at], b"\x55" * added, data[len(data) - at + lost :])
    summary = import_file([path], tmp_path / "a.h5")
    with open_recording(tmp_path / "a.h5") as recording:
        (camera,) = recording.cameras.values()
        events = camera.slice(0, recording.duration_us)
    meant = set(zip(VGA.t.tolist(), VGA.x.tolist(), VGA.y.tolist(), VGA.p.tolist(), strict=True))
    t = events.t_us + int(VGA.t[0])
    found = set(
        zip(t.tolist(), events.x_px.tolist(), events.y_px.tolist(), events.on.astype(int).tolist(), strict=True)
    )
    assert not found - meant and len(found) >= len(meant) - 40
    assert any("bytes were lost or added" in note for note in summary.notes)
