"""EVT4 words, composed here after the layout of the format."""

from __future__ import annotations

import numpy as np
import pytest

from core.errors import RecordingError
from core.events import SensorSize, concatenate_events
from core.recordings.sources import open_sources
from core.recordings.sources.source import DecodeReport

HEADER = "% camera_integration_name X\n% format EVT4;height=720;width=1280\n% end\n"


def high(value):
    return 0xE << 28 | value


def event(x, y, low, on):
    return (0xB if on else 0xA) << 28 | low << 22 | x << 11 | y


def vector(x, y, low, on, *bits):
    return [(0xD if on else 0xC) << 28 | low << 22 | x << 11 | y, sum(1 << bit for bit in bits)]


def trigger(channel, value, low):
    return 0x9 << 28 | low << 22 | channel << 8 | 5 << 1 | value


def write(path, words, header=HEADER, tail=b""):
    path.write_bytes(header.encode() + np.array(words, "<u4").tobytes() + tail)
    return path


def read(path, sensor=None):
    (source,) = open_sources(path, sensor)
    report = DecodeReport()
    events = concatenate_events(list(source.read(report)), source.sensor)
    rows = list(zip(events.t_us.tolist(), events.x_px.tolist(), events.y_px.tolist(), events.on.tolist(), strict=True))
    return rows, report, source


def test_single_events_and_vectors_have_their_time_place_and_polarity(tmp_path):
    words = [high(3), event(1279, 719, 5, True), *vector(5, 4, 6, False, 0, 3, 31), high(4), event(6, 5, 0, False)]
    rows, report, source = read(write(tmp_path / "a.raw", words))
    assert rows == [
        (197, 1279, 719, True),
        (198, 5, 4, False),
        (198, 8, 4, False),
        (198, 36, 4, False),
        (256, 6, 5, False),
    ]
    assert (source.format, source.sensor, report.notes) == ("Prophesee EVT4", SensorSize(1280, 720), [])


def test_the_mask_of_a_vector_is_no_word_of_its_own_whatever_it_looks_like(tmp_path):
    looks_like_time = [27, 31, 30, 29]
    words = [high(3), *vector(100, 4, 6, True, *looks_like_time), event(1, 1, 7, True)]
    rows, _, _ = read(write(tmp_path / "a.raw", words))
    assert [row[1] for row in rows] == [127, 129, 130, 131, 1]
    assert rows[-1][0] == 199


def test_padding_monitoring_and_triggers_lie_between_the_events(tmp_path):
    words = [
        0xFFFFFFFF,
        high(3),
        0x6 << 28 | 0x14,
        0x7 << 28 | 99,
        trigger(3, 1, 9),
        trigger(17, 0, 10),
        event(1, 2, 11, True),
    ]
    rows, report, _ = read(write(tmp_path / "a.raw", words))
    assert rows == [(203, 1, 2, True)]
    edges = [
        (int(t), bool(r), int(c))
        for part in report.triggers
        for t, r, c in zip(*(part.t_us, part.rising, part.channel), strict=True)
    ]
    assert edges == [(201, True, 3), (202, False, 17)]


def test_the_clock_wraps_after_28_bits(tmp_path):
    words = [high(2**28 - 2), event(1, 1, 0, True), high(2**28 - 1), high(0), event(2, 2, 1, True)]
    rows, _, _ = read(write(tmp_path / "a.raw", words))
    assert rows[1][0] - rows[0][0] == 2 * 64 + 1


def test_a_damaged_time_and_a_reserved_word_are_left_out_and_counted(tmp_path):
    words = []
    for step in range(1000):
        words += [high(1000 + step), event(step, 7, 0, True)]
    words[600] = high(77_000_000)
    words[900] = 0x1 << 28 | 12
    rows, report, _ = read(write(tmp_path / "a.raw", words))
    assert len(rows) == 1000
    times = np.array([row[0] for row in rows])
    expected = (1000 + np.arange(1000)) * 64
    assert np.abs(times - expected).max() == 64  # those two kept the coarse time before
    assert "1 words of a reserved type were left out" in report.notes[0]
    assert "1 damaged time words were ignored" in report.notes[1]


def test_vectors_across_blocks_and_a_cut_end_are_read(tmp_path):
    rng = np.random.default_rng(1)
    words = [high(1)]
    for i in range(130_000):
        words += vector(int(rng.integers(0, 1248)), int(rng.integers(0, 720)), 1, bool(i % 2), 0, 1)
    rows, report, _ = read(write(tmp_path / "a.raw", words[:-1], tail=b"\x01"))
    assert len(rows) == 2 * 129_999
    first = (words[1] >> 11) & 0x7FF
    assert [row[1] for row in rows[:2]] == [first, first + 1]
    assert "the last 5 bytes are no whole event" in report.notes[0]


def test_evt4_by_its_short_name_needs_a_size(tmp_path):
    path = write(tmp_path / "a.raw", [high(3), event(3, 4, 0, True)], header="% evt 4.0\n% end\n")
    with pytest.raises(RecordingError, match="does not say how large the sensor is; give --width and --height"):
        open_sources(path)
    assert read(path, SensorSize(640, 480))[0] == [(192, 3, 4, True)]


def test_words_of_another_version_are_not_taken_for_evt4(tmp_path):
    evt2 = [0x8 << 28 | 3, *(1 << 28 | 5 << 22 | x << 11 | 9 for x in range(500))]
    with pytest.raises(RecordingError, match="the words are not those of EVT4, which the header names"):
        open_sources(write(tmp_path / "a.raw", evt2))
