"""The EVT decoders: against faery, against words written by hand, and on real files."""

from __future__ import annotations

import numpy as np
import pytest
from faery import evt

from core.errors import RecordingError
from core.events import Events, SensorSize, concatenate_events
from core.recordings.sources import open_sources
from core.recordings.sources.evt2 import decode_evt2, start_state_evt2
from core.recordings.sources.evt_time import (
    BELIEVE,
    EVT2_TIME,
    EVT3_TIME,
    EVT21_TIME,
    IGNORE,
    STOP,
    Decoded,
    judge_time_high,
    next_time_high,
)
from core.recordings.sources.prophesee_header import read_prophesee_header
from core.recordings.sources.source import DecodeReport

HEADER3 = b"% evt 3.0\n% format EVT3;height=480;width=640\n% geometry 640x480\n% end\n"
HEADER2 = b"% evt 2.0\n% format EVT2;height=480;width=640\n% end\n"
HEADER21 = b"% evt 2.1\n% format EVT21;height=480;width=640\n% end\n"
LARGE = b"% geometry 1280x720\n% end\n"
"""The sensor of the paper's cameras: columns need eleven bits, rows ten."""


def read_all(path, sensor=None) -> tuple[Events, DecodeReport]:
    (source,) = open_sources(path, sensor)
    report = DecodeReport()
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
        (b"% evt: 3.0\n% geometry: 640x480\n% end\n", "EVT3", (640, 480)),
        (b"% format EVT3; height=480; width=640\n% end\n", "EVT3", (640, 480)),
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
        (b"% evt 5.0\n% geometry 640x480\n", "expected EVT2 or EVT2.1 or EVT3 or EVT4, got EVT5.0"),
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


BY_PROPHESEE = b"% camera_integrator_name Prophesee\n% plugin_integrator_name Prophesee\n% system_ID 49\n"


@pytest.mark.parametrize(
    ("stated", "swapped"),
    [
        (b"", False),
        (b"% endianness legacy\n", True),
        (b"% endianness little\n" + BY_PROPHESEE, False),
        (BY_PROPHESEE, True),  # an EVK3
        (b"% integrator_name Prophesee\n% system_ID 49\n", True),
        (BY_PROPHESEE.replace(b"49", b"55"), False),  # an EVK2
        (BY_PROPHESEE.replace(b"49", b"0"), False),
        (BY_PROPHESEE.replace(b"% plugin_integrator_name Prophesee", b"% plugin_integrator_name Maker"), False),
    ],
)
def test_the_header_tells_whether_words_of_evt21_are_swapped(tmp_path, stated, swapped):
    path = tmp_path / "a.raw"
    path.write_bytes(stated + HEADER21)
    assert read_prophesee_header(path).word_swapped == swapped


@pytest.mark.parametrize("version", ["EVT2", "EVT2.1", "EVT3"])
def test_zeros_within_a_file_are_no_events_and_no_row(tmp_path, version):
    write, words, zeros = {
        "EVT2": (evt2_file, [8 << 28 | 1, 1 << 28 | 9 << 22 | 5 << 11 | 6], 2),
        "EVT2.1": (evt21_file, [8 << 60 | 1 << 32, 1 << 60 | 9 << 54 | 5 << 43 | 6 << 32 | 1], 1),
        "EVT3": (evt3_file, [0x8001, 0x6009, 0x0006, 0x2805], 4),
    }[version]
    events, report = read_all(write(tmp_path, [*words, *[0] * zeros, *words[-1:], *words[-2:]]))
    assert f"a.raw: {zeros} words of reserved types (padding) were skipped." in report.notes
    assert len(report.notes) == 1
    rows = 2 if version == "EVT3" else 3  # what stands before the next row is named has none
    assert events.y_px.tolist() == [6] * rows and events.x_px.tolist() == [5] * rows


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


def evt21_file(tmp_path, words, header=HEADER21):
    path = tmp_path / "a.raw"
    path.write_bytes(header + np.array(words, "<u8").tobytes())
    return path


def test_evt3_has_eleven_bits_for_columns_and_rows_and_one_beside_them(tmp_path):
    words = [
        0x8001, 0x0000 | 719, 0x2000 | 1279, 0x2800 | 1279,
        0x0800 | 512, 0x2000 | 1024,  # bit 11 of a row names the camera of a pair, and is no part of the row
        0x3800 | 1256, 0x4801, 0x5081, 0x4004,  # on: columns 1256 and 1267, 1268 and 1275, 1278
        0x3000 | 1024, 0x4001,
    ]  # fmt: skip
    events, report = read_all(evt3_file(tmp_path, words, b"% evt 3.0\n" + LARGE))
    assert report.notes == []
    assert events.x_px.tolist() == [1279, 1279, 1024, 1256, 1267, 1268, 1275, 1278, 1024]
    assert events.y_px.tolist() == [719, 719] + [512] * 7
    assert events.on.tolist() == [False, True, False] + [True] * 5 + [False]


def test_evt2_and_evt21_have_eleven_bits_for_columns_and_rows(tmp_path):
    words2 = [8 << 28 | 1, 1 << 28 | 1279 << 11 | 719, 1024 << 11 | 512, 1023 << 11 | 511]
    events, report = read_all(evt2_file(tmp_path, words2, b"% evt 2.0\n" + LARGE))
    assert (events.x_px.tolist(), events.y_px.tolist()) == ([1279, 1024, 1023], [719, 512, 511])
    assert events.on.tolist() == [True, False, False] and report.notes == []
    words21 = [8 << 60 | 1 << 32, 1 << 60 | 1248 << 43 | 719 << 32 | 1 << 31 | 1, 1024 << 43 | 512 << 32 | 1]
    events, report = read_all(evt21_file(tmp_path, words21, b"% evt 2.1\n" + LARGE))
    assert (events.x_px.tolist(), events.y_px.tolist()) == ([1248, 1279, 1024], [719, 719, 512])
    assert events.on.tolist() == [True, True, False] and report.notes == []


def test_fine_times_have_six_bits_in_evt2_and_evt21_and_twelve_in_evt3(tmp_path):
    fine = [0, 31, 32, 63]
    two = evt2_file(tmp_path, [8 << 28 | 3] + [t << 22 for t in fine] + [8 << 28 | 4, 0])
    assert read_all(two)[0].t_us.tolist() == [192, 223, 224, 255, 256]
    one = evt21_file(tmp_path, [8 << 60 | 3 << 32] + [t << 54 | 1 for t in fine] + [8 << 60 | 4 << 32, 1])
    assert read_all(one)[0].t_us.tolist() == [192, 223, 224, 255, 256]
    words = [0x8003, 0x0001] + [word for t in (0, 2047, 2048, 4095) for word in (0x6000 | t, 0x2001)] + [0x8004, 0x2001]
    assert read_all(evt3_file(tmp_path, words))[0].t_us.tolist() == [12_288, 14_335, 14_336, 16_383, 16_384]


def test_fine_times_that_step_back_do_not_turn_time_round(tmp_path):
    two = [8 << 28 | 3, 40 << 22, 39 << 22, 0xA << 28 | 38 << 22, 41 << 22]
    events, report = read_all(evt2_file(tmp_path, two))
    assert events.t_us.tolist() == [232, 232, 233] and report.triggers[0].t_us.tolist() == [232]
    one = [8 << 60 | 3 << 32, 40 << 54 | 1, 39 << 54 | 1, 0xA << 60 | 38 << 54, 41 << 54 | 1]
    events, report = read_all(evt21_file(tmp_path, one))
    assert events.t_us.tolist() == [232, 232, 233] and report.triggers[0].t_us.tolist() == [232]
    events, _ = read_all(evt3_file(tmp_path, [0x8001, 0x0001, 0x6005, 0x2001, 0x6004, 0x2001, 0x6006, 0x2001]))
    assert events.t_us.tolist() == [4101, 4101, 4102]


SECOND = 100
"""A second in steps of the counter, chosen so that half of the counter is less than ten minutes."""


def time_words(*values):
    return np.array([8 << 12 | value for value in values], np.uint16)


@pytest.mark.parametrize(
    ("current", "value", "following", "verdict"),
    [
        (7, 8, 7, BELIEVE),
        (7, 107, 107, BELIEVE),
        (7, 107, 7, IGNORE),  # what follows says that it was wrong
        (7, 108, 7, IGNORE),  # more is damage if the next goes on from the current one
        (7, 108, 107, IGNORE),
        (7, 108, 109, BELIEVE),  # else a pause
        (7, 108, None, BELIEVE),
        (7, 7 + 2047, None, BELIEVE),  # up to half of the counter: beyond it, forward could as well be back
        (7, 7 + 2048, None, IGNORE),  # nobody confirms a step back
        (7, 7 + 2048, 7 + 2049, STOP),
        (7, 6, 6, STOP),
        (7, 6, None, IGNORE),
        (7, 6, 8, IGNORE),
        (4000, 4, None, BELIEVE),  # the counter wraps
        (4095, 98, 4095, IGNORE),
        (4095, 98, 99, BELIEVE),
        (4094, 1000, None, BELIEVE),  # "nothing follows" is no time
        (7, 1000, 0, IGNORE),  # those that follow do not go on from it
        (4095, 1000, 0, IGNORE),
    ],
)
def test_a_coarse_time_is_judged_by_its_step_and_the_next_one(current, value, following, verdict):
    words = time_words(value) if following is None else time_words(value, following)
    assert judge_time_high(words, 0, value, current, EVT3_TIME._replace(second=SECOND)) == verdict


def test_a_pause_of_ten_minutes_is_the_longest():
    words = np.array([8 << 28, 8 << 28 | 5 + 601 * SECOND], np.uint32)
    form = EVT2_TIME._replace(second=SECOND)
    at = [judge_time_high(words, 0, 5 + 600 * SECOND + more, 5, form) for more in (0, 1)]
    assert at == [BELIEVE, STOP]


def test_the_next_coarse_time_is_that_of_the_first_such_word():
    words = np.array([0x8123, 0x2001, 0x8FFF, 0x8004], np.uint16)
    assert [next_time_high(words, start, EVT3_TIME) for start in range(5)] == [0x123, 0xFFF, 0xFFF, 4, -1]
    wide = np.array([1 << 60, 8 << 60 | 0xABCDEF1 << 32 | 0xFFFF], np.uint64)
    assert next_time_high(wide, 0, EVT21_TIME) == 0xABCDEF1


@pytest.mark.parametrize("version", [2, 21])
def test_pauses_wraps_and_damaged_times_of_evt2_and_evt21(tmp_path, version):
    top, second = 0xFFFFFFF, 1_000_000 // 64

    def read(highs):
        words = []
        for high in highs:
            words += [8 << 28 | high, 1 << 28 | 1] if version == 2 else [8 << 60 | high << 32, 1 << 60 | 1]
        events, report = read_all((evt2_file if version == 2 else evt21_file)(tmp_path, words))
        return (events.t_us // 64).tolist(), report.notes

    assert read([5, 5 + second + 1, 5 + second + 2]) == ([5, 5 + second + 1, 5 + second + 2], [])
    assert read([top, 0, 1]) == ([top, top + 1, top + 2], [])
    times, notes = read([5, 5 ^ 1 << 27, 6])
    assert times == [5, 5, 6] and notes == ["a.raw: 1 damaged time words were ignored."]
    times, notes = read([50, 40, 40])
    assert times == [50] and "the time jumps back" in notes[0]


@pytest.mark.parametrize(("between", "kept"), [(4000, 3), (4200, 3 + 4192)])
def test_a_jump_in_time_just_before_damage_is_part_of_it(tmp_path, between, kept):
    jump = 5 + 20_000
    two = [8 << 28 | 5] + [1] * 3 + [8 << 28 | jump] * 9 + [1] * (between - 8) + [8 << 28 | 5] * 2
    one = [8 << 60 | 5 << 32] + [1] * 3 + [8 << 60 | jump << 32] * 9 + [1] * (between - 8) + [8 << 60 | 5 << 32] * 2
    for events, report in (read_all(evt2_file(tmp_path, two)), read_all(evt21_file(tmp_path, one))):
        assert len(events) == kept and "the time jumps back" in report.notes[0]


@pytest.mark.parametrize(("words", "largest"), [([640 << 11], "640, 0"), ([480], "0, 480"), ([639 << 11 | 479], None)])
def test_an_event_of_evt2_and_evt21_beside_the_sensor_is_left_out(tmp_path, words, largest):
    two = [8 << 28 | 5, 1 << 28 | 1, *words, 2]
    wide = [(word >> 28) << 60 | (word & 0xFFFFFFF) << 32 | (word < 8 << 28) for word in two]
    for events, report in (read_all(evt2_file(tmp_path, two)), read_all(evt21_file(tmp_path, wide))):
        assert len(events) == (3 if largest is None else 2) and events.y_px[-1] == 2
        said = f"a.raw: 1 events outside the 640x480 sensor were left out (addresses up to {largest})."
        assert report.notes == ([] if largest is None else [said])


def test_a_coarse_time_of_evt2_and_evt21_that_steps_back_for_good_ends_the_events(tmp_path):
    two = [8 << 28 | 5, 1 << 28 | 1, 8 << 28 | 1, 8 << 28 | 1, 2]
    wide = [(word >> 28) << 60 | (word & 0xFFFFFFF) << 32 | (word < 8 << 28) for word in two]
    for events, report in (read_all(evt2_file(tmp_path, two)), read_all(evt21_file(tmp_path, wide))):
        assert len(events) == 1 and "the time jumps back" in report.notes[0]


def test_pixels_of_an_evt21_word_that_leave_the_sensor_are_left_out(tmp_path):
    events, report = read_all(evt21_file(tmp_path, [8 << 60 | 5 << 32, 638 << 43 | 0b111, 1]))
    assert events.x_px.tolist() == [638, 639, 0] and "1 events outside the 640x480 sensor" in report.notes[0]


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


def test_evt3_time_that_jumps_back_for_good_ends_the_events_and_the_note_names_the_byte(tmp_path):
    good = [0x8100, 0x0001] + [0x2001] * 5000
    path = evt3_file(tmp_path, [*good, 0x8001, 0x8001] + [0x2002] * 10)
    events, report = read_all(path)
    assert len(events) == 5000
    at = len(HEADER3) + 2 * len(good)
    reason = "the time jumps back or too far ahead"
    assert report.notes == [f"a.raw: stopped at byte {at:,} of {path.stat().st_size:,}: {reason}."]


@pytest.mark.parametrize("word", [0x9999, 0x9000, 0xB123, 0xC000, 0xDFFF])
def test_evt3_words_of_reserved_types_are_skipped_and_counted(tmp_path, word):
    events, report = read_all(evt3_file(tmp_path, [0x8100, 0x0001, 0x2001, word, word, 0x2002, word, 0x2003]))
    assert events.x_px.tolist() == [1, 2, 3] and events.y_px.tolist() == [1, 1, 1]
    assert report.notes == ["a.raw: 3 words of reserved types (padding) were skipped."]


@pytest.mark.parametrize(
    ("words", "kept", "largest"),
    [
        ([0x2000 | 640], [], "640, 1"),
        ([0x3000 | 639, 0x4000 | 0b11], [639], "640, 1"),
        ([0x0000 | 480, 0x2005, 0x0001], [], "5, 480"),
    ],
)
def test_evt3_addresses_beside_the_sensor_are_left_out_and_the_rest_is_kept(tmp_path, words, kept, largest):
    events, report = read_all(evt3_file(tmp_path, [0x8100, 0x0001] + [0x2001] * 500 + words + [0x2002] * 10))
    assert events.x_px.tolist() == [1] * 500 + kept + [2] * 10 and set(events.y_px.tolist()) == {1}
    assert report.notes == [f"a.raw: 1 events outside the 640x480 sensor were left out (addresses up to {largest})."]


def test_a_size_that_is_wrong_for_many_events_is_refused_with_one_that_holds_them(tmp_path):
    path = evt3_file(tmp_path, [0x8100, 0x0001] + [0x2001] * 300 + [0x2000 | 1279, 0x0000 | 719, 0x2001] * 10)
    with pytest.raises(RecordingError, match=r"events lie outside the 640x480 sensor; expected.*at least 1280x720"):
        read_all(path)


def test_memory_does_not_grow_with_what_words_expand_to(tmp_path):
    path = evt3_file(tmp_path, [0x8001, 0x0001] + [0x3000, 0x4FFF] * 400_000)
    (source,) = open_sources(path)
    parts = list(source.read(DecodeReport()))
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
    out = Decoded.empty(7, 4)
    times: list[int] = []
    while len(words):
        used, count, _, damage = decode_evt2(words, state, 640, 480, out)
        assert damage == 0 and count <= 7
        times += out.t_us[:count].tolist()
        words = words[used:]
    assert times == list(range(64, 124))
