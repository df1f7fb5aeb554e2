"""The EVT decoders: against faery, against words written by hand, and on real files."""

from __future__ import annotations

import numpy as np
import pytest
from faery import evt

from core.errors import RecordingError
from core.events import Events, SensorSize, concatenate_events
from core.recordings.sources import open_sources
from core.recordings.sources.evt2 import decode_evt2, start_state_evt2
from core.recordings.sources.source import Report

HEADER3 = b"% evt 3.0\n% format EVT3;height=480;width=640\n% geometry 640x480\n% end\n"
HEADER2 = b"% evt 2.0\n% format EVT2;height=480;width=640\n% end\n"
HEADER21 = b"% evt 2.1\n% format EVT21;height=480;width=640\n% end\n"


def read_all(path, sensor=None) -> tuple[Events, Report]:
    (source,) = open_sources(path, sensor)
    report = Report()
    return concatenate_events(list(source.read(report)), source.sensor), report


def evt3_file(tmp_path, words, header=HEADER3):
    path = tmp_path / "a.raw"
    path.write_bytes(header + np.array(words, "<u2").tobytes())
    return path


def evt2_file(tmp_path, words, header=HEADER2):
    path = tmp_path / "a.raw"
    path.write_bytes(header + np.array(words, "<u4").tobytes())
    return path


@pytest.mark.parametrize("name", ["walker_evt3_640x480.raw", "rotating_dot_evt2_640x480.raw"])
def test_real_files_give_the_events_and_triggers_that_faery_gives(shared_events, name):
    events, report = read_all(shared_events / name)
    with evt.Decoder(shared_events / name, (640, 480), None) as decoder:
        packets = list(decoder)
    expected = np.concatenate([packet["events"] for packet in packets if "events" in packet])
    for ours, theirs in (("t_us", "t"), ("x_px", "x"), ("y_px", "y"), ("on", "on")):
        np.testing.assert_array_equal(getattr(events, ours), expected[theirs])
    triggers = [packet["triggers"] for packet in packets if "triggers" in packet]
    if triggers:
        np.testing.assert_array_equal(
            np.concatenate([part.t_us for part in report.triggers]), np.concatenate(triggers)["t"]
        )
        np.testing.assert_array_equal(
            np.concatenate([part.rising for part in report.triggers]), np.concatenate(triggers)["rising"]
        )
        assert {int(channel) for part in report.triggers for channel in part.channel} == {6}
    assert report.notes == []
    assert report.share == 1.0


def test_the_old_header_without_a_geometry_gives_the_sensor_by_its_plug_in(shared_events):
    (source,) = open_sources(shared_events / "rotating_dot_evt2_640x480.raw")
    assert source.format == "Prophesee EVT2"
    assert source.sensor == SensorSize(640, 480)


@pytest.mark.parametrize(
    ("header", "version", "sensor"),
    [
        (b"% plugin_name hal_plugin_gen3_fx3\n", "EVT2", (640, 480)),
        (b"% evt 3.0\n% plugin_name hal_plugin_imx636_psee\n", "EVT3", (1280, 720)),
        (b"% evt 3.0\n% plugin_name hal_plugin_gen41_evk3\n", "EVT3", (1280, 720)),
        (b"% evt 2.1\n% sensor_name GenX320\n", "EVT2.1", (320, 320)),
        (b"% evt 2.0\n% geometry 304x240\n% end\n", "EVT2", (304, 240)),
        (b"% format EVT21;endianness=legacy;height=100;width=200\n", "EVT2.1", (200, 100)),
    ],
)
def test_headers_of_every_age_are_understood(tmp_path, header, version, sensor):
    path = tmp_path / "a"
    path.write_bytes(header + b"\0" * 16)
    (source,) = open_sources(path)
    assert source.format == f"Prophesee {version}"
    assert source.sensor == SensorSize(*sensor)
    (source,) = open_sources(path, SensorSize(11, 12)) if b"evt" in header or b"EVT" in header else (source,)
    assert source.sensor == (SensorSize(11, 12) if b"evt" in header or b"EVT" in header else SensorSize(*sensor))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"% evt 4.0\n% geometry 640x480\n", "expected EVT2 or EVT2.1 or EVT3, got EVT4.0"),
        (b"% evt 3.0\n", "does not say how large the sensor is; give --width and --height"),
        (b"% geometry 1280x720\n", "names no version"),
    ],
)
def test_headers_that_say_too_little_are_refused(tmp_path, header, message):
    path = tmp_path / "a.raw"
    path.write_bytes(header + b"\0" * 16)
    with pytest.raises(RecordingError, match=message):
        open_sources(path)


def test_evt3_vectors_triggers_and_the_wrap_of_its_clock(tmp_path):
    words = [
        0x8FFF, 0x6FFE, 0x0007, 0x2800 | 5,  # the last 4 ms before the wrap; row 7, column 5, on
        0xA601, 0x3000 | 600, 0x4000 | 0b101, 0x5000 | 0b10000001,  # trigger 6 rises; columns 600, 602, then 612, 619
        0x8000, 0x6001, 0x2000 | 639, 0xA600,  # the clock has wrapped; off
        0xE000, 0xF000, 0x7000,  # monitoring words, skipped
    ]  # fmt: skip
    events, report = read_all(evt3_file(tmp_path, words))
    last = (0xFFF << 12) + 0xFFE
    assert events.t_us.tolist() == [last] * 5 + [(1 << 24) + 1]
    assert events.x_px.tolist() == [5, 600, 602, 612, 619, 639]
    assert events.y_px.tolist() == [7] * 6
    assert events.on.tolist() == [True, False, False, False, False, False]
    (triggers,) = report.triggers
    assert triggers.t_us.tolist() == [last, (1 << 24) + 1]
    assert triggers.rising.tolist() == [True, False]
    assert triggers.channel.tolist() == [6, 6]
    assert report.notes == []


def test_evt2_triggers_and_the_wrap_of_its_clock(tmp_path):
    top = 0xFFFFFFF
    words = [0x8 << 28 | top, 1 << 28 | 63 << 22 | 10 << 11 | 20, 0xA << 28 | 63 << 22 | 3 << 8 | 1, 0x8 << 28, 5 << 22]
    events, report = read_all(evt2_file(tmp_path, words))
    assert events.t_us.tolist() == [(top << 6) + 63, (1 << 34) + 5]
    assert events.x_px.tolist() == [10, 0]
    assert events.y_px.tolist() == [20, 0]
    assert events.on.tolist() == [True, False]
    (triggers,) = report.triggers
    assert (triggers.t_us.tolist(), triggers.channel.tolist(), triggers.rising.tolist()) == (
        [(top << 6) + 63], [3], [True],
    )  # fmt: skip


@pytest.mark.parametrize("swapped", [False, True])
def test_evt21_sets_up_to_32_pixels_of_a_row_at_once(tmp_path, swapped):
    word = 1 << 60 | 9 << 54 | 64 << 43 | 33 << 32 | 0b1000_0000_0000_0000_0000_0000_0000_0101
    words = np.array([8 << 60 | 1000 << 32, word, 0xA << 60 | 10 << 54 | 2 << 40 | 1 << 32], "<u8")
    header = HEADER21
    if swapped:
        words = (words >> np.uint64(32)) | (words << np.uint64(32))
        header = HEADER21.replace(b"EVT21;", b"EVT21;endianness=legacy;")
    path = tmp_path / "a.raw"
    path.write_bytes(header + words.tobytes())
    events, report = read_all(path)
    assert events.x_px.tolist() == [64, 66, 95]
    assert events.y_px.tolist() == [33] * 3
    assert events.t_us.tolist() == [64_009] * 3
    assert events.on.all()
    assert report.triggers[0].channel.tolist() == [2]


def test_what_stands_before_the_first_coarse_time_is_kept(tmp_path):
    early = evt3_file(tmp_path, [0x6005, 0x0001, 0x2001, 0x8001, 0x6001, 0x2001])
    assert read_all(early)[0].t_us.tolist() == [5, 4097]  # software leaves out the coarse time 0
    late = evt3_file(tmp_path, [0x6005, 0x0001, 0x2001, 0x8064, 0x6006, 0x2001])
    assert read_all(late)[0].t_us.tolist() == [100 * 4096 + 5, 100 * 4096 + 6]  # a camera repeats it


def test_a_pause_of_the_camera_is_kept(tmp_path):
    words = [0x8001, 0x0001, 0x2001, 0x8001 + 1000, 0x2002, 0x8002 + 1000, 0x2003]
    events, report = read_all(evt3_file(tmp_path, words))
    assert events.t_us.tolist() == [4096, 4096 * 1001, 4096 * 1002]
    assert report.notes == []


def test_one_damaged_time_word_is_ignored_and_noted(tmp_path):
    words = [0x8001, 0x0001, 0x2001, 0x8001 ^ 0x400, 0x2002, 0x8002, 0x2003]
    events, report = read_all(evt3_file(tmp_path, words))
    assert events.t_us.tolist() == [4096, 4096, 8192]
    assert report.notes == ["a.raw: 1 damaged time words were ignored."]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([0x9000], "a word of unknown type"),
        ([0x2000 | 640], "a column outside the sensor"),
        ([0x3000 | 639, 0x4000 | 0b11], "a column outside the sensor"),
        ([0x0000 | 480], "a row outside the sensor"),
        ([0x8001, 0x8001], "the time jumps back or too far ahead"),
    ],
)
def test_the_first_impossible_word_ends_the_events_and_the_note_names_its_byte(tmp_path, words, reason):
    good = [0x8100, 0x0001] + [0x2001] * 5000
    path = evt3_file(tmp_path, good + words + [0x2002] * 10)
    events, report = read_all(path)
    vector = 1 if words[0] == 0x3000 | 639 else 0  # the pixel 639 itself is there
    assert len(events) == 5000 + vector
    at = len(HEADER3) + 2 * (len(good) + vector)
    assert report.notes == [f"a.raw: stopped at byte {at:,} of {path.stat().st_size:,}: {reason}."]


def test_memory_does_not_grow_with_what_words_expand_to(tmp_path):
    path = evt3_file(tmp_path, [0x8001, 0x0001] + [0x3000, 0x4FFF] * 400_000)
    (source,) = open_sources(path)
    parts = list(source.read(Report()))
    assert sum(map(len, parts)) == 12 * 400_000
    assert max(map(len, parts)) <= 1 << 18


def test_a_file_that_ends_within_a_word_is_noted(tmp_path):
    path = evt2_file(tmp_path, [0x8 << 28 | 5, 1 << 28])
    path.write_bytes(path.read_bytes() + b"abc")
    events, report = read_all(path)
    assert len(events) == 1
    assert report.notes == ["a.raw: the last 3 bytes are not a whole word; the file was cut short."]


def test_a_header_alone_is_an_empty_recording(tmp_path):
    events, report = read_all(evt3_file(tmp_path, []))
    assert len(events) == 0
    assert report.notes == []


def test_decoding_continues_where_room_ran_out():
    words = np.array([8 << 28 | 1] + [1 << 28 | i << 22 for i in range(60)], np.uint32)
    state = start_state_evt2(words)
    t, x, y, on = np.empty(7, np.int64), np.empty(7, np.uint16), np.empty(7, np.uint16), np.empty(7, np.bool_)
    spare = np.empty(4, np.int64), np.empty(4, np.bool_), np.empty(4, np.int16)
    times: list[int] = []
    while len(words):
        used, count, _, damage = decode_evt2(words, state, 640, 480, t, x, y, on, *spare)
        assert damage == 0 and count <= 7
        times += t[:count].tolist()
        words = words[used:]
    assert times == list(range(64, 124))
