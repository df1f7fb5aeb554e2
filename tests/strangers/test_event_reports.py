"""Event files of public reports: what somebody had trouble with elsewhere, made here, is read right or refused.

Each case names the report, says what the file is, and what is expected: the events, or a line that says what is wrong.
"""

from __future__ import annotations

import os
import re
import struct
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from core.errors import RallyscopeError
from core.events import SensorSize
from core.recordings import ImportOrder, import_recording, open_recording
from core.recordings.importing import ImportSummary
from core.recordings.sources.source import ImportOptions
from tests.strangers import event_files as make

VGA = make.draw_rows(640, 480)
DAVIS = make.draw_rows(346, 260)
SQUARE = make.draw_rows(320, 320)
SMALL = make.draw_rows(34, 34, count=600, span_us=300_000)
BLUE = b"Davis346blue"
ATIS = make.draw_rows(304, 240)
HEAD2 = b"% evt 2.0\n% geometry 640x480\n% end\n"
HEAD21 = b"% evt 2.1\n% geometry 640x480\n% end\n"
HEAD3 = b"% evt 3.0\n% geometry 640x480\n% end\n"
HEAD4 = b"% evt 4.0\n% geometry 640x480\n% end\n"
DAT1 = b"% Data file containing CD events.\n% Version 1\n% Date 2014-06-30 12:00:00\n"
DAT2 = b"% Data file containing CD events.\n% Version 2\n% Width 640\n% Height 480\n"
DAT2_TURNED = b"% Data file containing CD events.\n% Version 2\n% Width 480\n% Height 640\n"
pytestmark = pytest.mark.usefixtures("data_set_readers")
EPOCH_US = 1_600_000_000_000_000
UNSTATED = ImportOptions()
UPSIDE = np.where(VGA.p, 1, -1)
FULL = VGA.with_row(0, int(VGA.t[0]), 639, 479, 1)
"""With the last pixel of the sensor."""
UPSIDE_FULL = np.where(FULL.p, 1, -1)
WIDE = VGA._replace(x=np.where(np.arange(len(VGA.t)) < 8, 600, VGA.x % 480), y=VGA.y % 470)
"""Few events lie beside 480 columns: too few to refuse a size for."""
NARROW = VGA._replace(x=VGA.x % 480, y=VGA.y + 100)
TD_NAMES = ("ts", "x", "y", "p")
SIZE = {"width": 640, "height": 480}
IMU = struct.pack("<hhiiiiii", 3, 1, 36, 4, 0, 1, 1, 1) + bytes(36)
"""A packet of AEDAT 3 that holds no events."""


def import_file(paths, out, **options) -> ImportSummary:
    """What an import says that nobody cancels."""
    summary = import_recording(ImportOrder(paths, **options), out)
    assert summary is not None
    return summary


def faery_csv(rows):
    """Text with the size of the sensor in the names of its columns."""
    lines = (f"{t},{x},{y},{'true' if p else 'false'}" for t, x, y, p in zip(*(c.tolist() for c in rows), strict=True))
    return ("t,x@640,y@480,on\n" + "\n".join(lines) + "\n").encode()


def zipped(path, name, content):
    """An archive of one member."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, content)
    return path


def later(rows, by_us):
    """The same events on a clock that began earlier."""
    return rows._replace(t=rows.t + by_us)


def again(rows, first, last, *, at):
    """The same events with some of them once more in front of another."""
    return make.Rows(*(np.concatenate([column[:at], column[first:last], column[at:]]) for column in rows))


def columns(rows, names: Sequence[str] = "txyp", **changes):
    """Columns by name."""
    return {name: changes.get(name, column) for name, column in zip(names, rows, strict=True)}


def group(path, items):
    """The same under a path."""
    return {path + name: value for name, value in items.items()}


def in_order(rows, order):
    """A table of four columns in this order."""
    return np.stack([columns(rows)[name] for name in order], axis=1)


def records(rows):
    """A structured array."""
    out = np.zeros(len(rows.t), [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    out["x"], out["y"], out["p"], out["t"] = rows.x, rows.y, rows.p, rows.t
    return out


def m3ed(path, p, unit=1):
    """One camera of M3ED."""
    group = "prophesee/left/"
    items = {group + name: column for name, column in columns(VGA, t=VGA.t * unit, p=p).items()}
    items[group + "calib/resolution"] = np.array([640, 480])
    items[group + "ms_map_idx"] = np.searchsorted(VGA.t, np.arange(0, 490_000, 1000))
    return make.hdf5(path, items)


def m3ed_pair(path, apart):
    """Both cameras of M3ED with their calibration."""
    items = {}
    for side, x in (("left", 0.0), ("right", apart)):
        T = np.eye(4)
        T[0, 3] = x
        calib = {"resolution": [640, 480], "intrinsics": [500.0, 500, 320, 240], "T_to_prophesee_left": T}
        items |= {f"prophesee/{side}/{name}": value for name, value in columns(VGA).items()}
        items |= {f"prophesee/{side}/calib/{name}": value for name, value in calib.items()}
    return make.hdf5(path, items)


@dataclass(frozen=True)
class Case:
    """One report."""

    report: str
    what: str
    write: Callable[[Path], Path]
    rows: object = VGA
    """What is expected; None if the file is refused."""
    said: str = ""
    """Part of a note, or of the refusal."""
    sensor: str = "640x480"
    given: SensorSize | None = None
    options: ImportOptions = UNSTATED
    within_us: int = 0
    needs_size: bool = True
    """Whether the size is given if the format cannot state it."""
    suffix: str = ".bin"


def stray(k, t, x=5, y=7):
    """The events with one more at row k."""
    return VGA.with_row(k, t, x, y, 1)


CASES = [
    # Prophesee RAW
    Case("prophesee-ai/openeb#108", "EVT3 whose first event is at 6.4 s of the camera's clock",
         lambda p: make.write(p, make.raw(later(VGA, 6_437_104), "evt3", HEAD3))),
    Case("neuromorphicsystems/neuromorphic-drivers#1", "EVT3 beyond 24 bits: the coarse time begins again",
         lambda p: make.write(p, make.raw(later(VGA, (1 << 24) - 200_000), "evt3", HEAD3))),
    Case("ros-event-camera/event_camera_renderer#8", "EVT3 with the padding 0x9999 of Lucid cameras",
         lambda p: make.write(p, make.raw(VGA, "evt3", HEAD3, {k: [0x9999] * 9 for k in range(0, 2000, 40)})),
         said="words of reserved types"),
    Case("open-neuromorphic/expelliarmus#8", "EVT3 with words CONTINUED_4 and OTHERS",
         lambda p: make.write(p, make.raw(VGA, "evt3", HEAD3, {70: [0xE012, 0x7003, 0x7001, 0xF123]}))),
    Case("open-neuromorphic/expelliarmus#18", "EVT3 with words of external triggers",
         lambda p: make.write(p, make.raw(VGA, "evt3", HEAD3, {70: [0xA001], 90: [0xA000]}))),
    Case("open-neuromorphic/expelliarmus#19", "EVT3 whose coarse time steps back for a word, 24 times",
         lambda p: make.write(p, make.raw(VGA, "evt3", HEAD3, {
             k: [make.coarse_time("evt3", (int(VGA.t[k]) >> 12) - 3)] for k in range(60, 1900, 80)})),
         said="damaged time words were ignored"),
    Case("open-neuromorphic/expelliarmus#6", "EVT2 whose first events stand before the first coarse time, at 3000 s",
         lambda p: make.write(p, HEAD2, np.insert(np.delete(
             make.evt_words(later(VGA, 3 << 30), "evt2"), 0), 1, [make.coarse_time("evt2", 3 << 24)])
             .astype("<u4").tobytes())),
    Case("inivation/libcaer#69", "EVT2 whose coarse time steps back for two words",
         lambda p: make.write(p, make.raw(VGA, "evt2", HEAD2, {900: [8 << 28 | 5, 8 << 28 | 6]})),
         said="2 damaged time words were ignored"),
    Case("inivation/libcaer#69", "EVT2.1 whose coarse time steps back for two words",
         lambda p: make.write(p, make.raw(VGA, "evt2.1", HEAD21, {900: [8 << 60 | 5 << 32, 8 << 60 | 6 << 32]})),
         said="2 damaged time words were ignored"),
    Case("ros-event-camera/metavision_driver#61", "EVT2.1 of a GenX320, header of its newer kind",
         lambda p: make.write(p, make.raw(SQUARE, "evt2.1", b"% format EVT21;height=320;width=320\n% end\n")),
         rows=SQUARE, sensor="320x320"),
    Case("prophesee-ai/openeb#151", "EVT2.1 of a driver that states no size",
         lambda p: make.write(p, make.raw(VGA, "evt2.1", b"% evt 2.1\n% plugin_name hal_plugin_prophesee\n% end\n")),
         rows=None, said="does not say how large the sensor is; give --width and --height"),
    Case("prophesee-ai/openeb#151", "the same with the size given",
         lambda p: make.write(p, make.raw(VGA, "evt2.1", b"% evt 2.1\n% plugin_name hal_plugin_prophesee\n% end\n")),
         given=SensorSize(640, 480)),
    Case("prophesee-ai/openeb#111", "EVT4 with padding, reserved words and one address outside",
         lambda p: make.write(p, make.raw(VGA, "evt4", HEAD4, {50: [0xFFFFFFFF] * 5 + [0x20000000], 80: [0xBFFFFFFF]})),
         said="1 events outside the 640x480 sensor"),
    Case("shiba24/event-vision-library#175", "EVT3 whose header names a laboratory in Latin-1",
         lambda p: make.write(p, make.raw(VGA, "evt3", "% evt 3.0\n% owner Universität Zürich\n".encode("latin-1")
                                         + b"% geometry 640x480\n% end\n"))),
    Case("shiba24/event-vision-library#406", "EVT2 under a header that says EVT3",
         lambda p: make.write(p, make.raw(VGA, "evt2", HEAD3)), rows=None, said="lie outside the 640x480 sensor"),
    Case("inivation/libcaer#69", "EVT4 whose coarse time steps back by seconds for two words",
         lambda p: make.write(p, make.raw(later(VGA, 9_000_000), "evt4", HEAD4, {900: [14 << 28 | 5, 14 << 28 | 6]})),
         said="2 damaged time words were ignored"),
    *(Case("inivation/libcaer#69", f"{kind.upper()} with a packet of 20 coarse times {step:+} s off",
           lambda p, kind=kind, head=head, step=step: make.write(p, make.raw(later(VGA, 9_000_000), kind, head, {
               900: [make.coarse_time(kind, int((VGA.t[900] + 9_000_000) / (4096 if kind == "evt3" else 64)
                                                + step * 1e6 / (4096 if kind == "evt3" else 64)))] * 20})),
           said="damaged time words were ignored", within_us=20_000)
      for kind, head in (("evt2", HEAD2), ("evt2.1", HEAD21), ("evt3", HEAD3), ("evt4", HEAD4)) for step in (-3, 2)),
    Case("open-neuromorphic/expelliarmus#19", "EVT3 with one fine time ahead of the others, and one behind",
         lambda p: make.write(p, make.raw(VGA, "evt3", HEAD3, {700: [0x6FFF], 800: [0x6000]})),
         said="damaged time words were ignored"),
    Case("prophesee-ai/openeb#108", "EVT2 with a block of zeros at its end",
         lambda p: make.write(p, make.raw(VGA, "evt2", HEAD2), bytes(4096)),
         said="1,024 words of reserved types (padding) were skipped"),
    Case("prophesee-ai/openeb#111", "EVT4 with a block of zeros at its end",
         lambda p: make.write(p, make.raw(VGA, "evt4", HEAD4), bytes(4096))),
    *(Case("prophesee-ai/openeb#108", f"EVT3 whose header says {head!r}",
           lambda p, head=head: make.write(p, make.raw(VGA, "evt3", b"% evt 3.0\n" + head + b"\n% end\n")))
      for head in (b"% geometry 640,480", b"% geometry: 640X480", b"%Width 640\r\n%Height 480")),
    Case("prophesee-ai/openeb#108", "EVT3 whose header states two sizes",
         lambda p: make.write(p, make.raw(VGA, "evt3", b"% format EVT3;height=720;width=1280\n" + HEAD3)),
         sensor="1280x720", said="states two sensor sizes, 1280x720 and 640x480; the first is taken"),
    # DAT
    Case("uzh-rpg/rpg_dvs_ros#57", "DAT with a packet of 300 events that came long before",
         lambda p: make.write(p, make.dat(again(VGA, 200, 500, at=900), DAT2)),
         said="300 events were left out: their times lie apart"),
    Case("uzh-rpg/rpg_dvs_ros#57", "DAT whose clock begins again for good: what follows is another recording",
         lambda p: make.write(p, make.dat(again(VGA, 0, 900, at=900), DAT2)),
         rows=make.Rows(*(c[:900] for c in VGA)), said="and goes on from there"),
    *(Case("prophesee-ai/prophesee-automotive-dataset-toolbox#36", f"DAT with a block of {fill} at its end",
           lambda p, fill=fill: make.write(p, make.dat(VGA, DAT2), fill * 4096), said="512 rows of zeros or ones")
      for fill in (b"\0", b"\xff")),
    Case("prophesee-ai/prophesee-automotive-dataset-toolbox#36", "DAT whose sides are exchanged in the header",
         lambda p: make.write(p, make.dat(VGA, DAT2_TURNED)),
         rows=None, said="expected 640x480, which would hold them: width and height are exchanged"),
    Case("rfma23/aertb#1", "DAT of event type 0",
         lambda p: make.write(p, make.dat(VGA, DAT2, kind=0))),
    Case("rfma23/aertb#1", "DAT of version 1: nine bits of column, eight of row",
         lambda p: make.write(p, make.dat(ATIS, DAT1, kind=0, old=True)), rows=ATIS, sensor="304x240"),
    Case("prophesee-ai/prophesee-automotive-dataset-toolbox#36", "DAT with one event at x = 1308 of a smaller sensor",
         lambda p: make.write(p, make.dat(stray(900, VGA.t[900], 1308), DAT2)),
         said="1 events outside the 640x480 sensor"),
    Case("prophesee-ai/prophesee-automotive-dataset-toolbox#43", "DAT with one event whose time is 3000 s ahead",
         lambda p: make.write(p, make.dat(stray(900, 3_000_000_000), DAT2)), said="1 events were left out"),
    Case("uzh-rpg/rpg_dvs_ros#57", "DAT with one event 99 ms behind its neighbours",
         lambda p: make.write(p, make.dat(stray(900, VGA.t[900] - 99_000), DAT2)), said="1 events were left out"),
    Case("aestream/faery#22", "DAT whose clock of 32 bits begins again",
         lambda p: make.write(p, make.dat(later(VGA, (1 << 32) - 200_000), DAT2)), said="the clock began again"),
    # AEDAT, Event Stream, N-MNIST
    Case("SensorsINI/DHP19#8", "AEDAT 2.0 with an event at y = 306 of a DAVIS346",
         lambda p: make.write(p, make.aedat2(DAVIS.with_row(500, DAVIS.t[500], 345, -47, 0), BLUE, 346, 260)),
         rows=DAVIS, sensor="346x260", said="1 events outside the 346x260 sensor"),
    Case("inivation/libcaer#69", "AEDAT 2.0 with one time of an hour ahead",
         lambda p: make.write(p, make.aedat2(DAVIS.with_row(500, 4_000_000_000, 5, 7, 0), b"Davis346blue", 346, 260)),
         rows=DAVIS, sensor="346x260", said="1 events were left out"),
    Case("inivation/libcaer#69", "AEDAT 2.0 whose first events are left over from the session before",
         lambda p: make.write(p, make.aedat2(make.Rows(*(np.concatenate([a[:20], b]) for a, b in zip(
             later(DAVIS, 900_000_000), DAVIS, strict=True))), b"Davis346blue", 346, 260)),
         rows=DAVIS, sensor="346x260", said="20 events were left out"),
    Case("SensorsINI/v2e#16", "AEDAT 2.0 of a camera whose addresses are not known",
         lambda p: make.write(p, make.aedat2(DAVIS, b"Celex5", 346, 260)), rows=None,
         said="the addresses of this camera are not known"),
    Case("neuromorphs/tonic#224", "AEDAT 3.1 where AEDAT4 is expected",
         lambda p: make.write(p, b"#!AER-DAT3.1\r\n#Format: RAW\r\n"), rows=None, said="header has no end"),
    Case("neuromorphs/tonic#224", "AEDAT 3.1 of a DAVIS346, with a packet of the IMU in between",
         lambda p: make.write(p, make.aedat3(DAVIS, more=IMU)), rows=DAVIS, sensor="346x260", needs_size=False),
    Case("neuromorphs/tonic#224", "AEDAT 3.1 whose clock of 31 bits goes on in the header of the packet",
         lambda p: make.write(p, make.aedat3(later(DAVIS, 5 << 31))), rows=DAVIS, sensor="346x260", needs_size=False),
    Case("neuromorphs/tonic#224", "AEDAT 3.1 that was cut within a packet",
         lambda p: make.write(p, make.aedat3(DAVIS) + make.aedat3(DAVIS)[-1000:-7]), rows=DAVIS, sensor="346x260",
         said="no whole packet follows", needs_size=False),
    Case("aestream/faery", "the CSV that faery writes: the size stands behind the names",
         lambda p: make.write(p, faery_csv(VGA)), needs_size=False),
    Case("neuromorphs/tonic#213", "MATLAB: a struct TD of columns in version 5",
         lambda p: make.mat5(p, TD={name: column[:, None] for name, column in columns(VGA, TD_NAMES).items()})),
    Case("neuromorphs/tonic#213", "MATLAB: addresses that count from 1, and the size of the sensor",
         lambda p: make.mat5(p, TD={**columns(FULL, TD_NAMES, x=FULL.x + 1, y=FULL.y + 1, p=UPSIDE_FULL), **SIZE}),
         rows=FULL, said="count from 1", needs_size=False),
    Case("gorchard/Matlab_AER_vision_functions", "MATLAB: addresses that count from 1 and fill a usual sensor",
         lambda p: make.mat5(p, TD=columns(FULL, TD_NAMES, x=FULL.x + 1, y=FULL.y + 1, p=UPSIDE_FULL)),
         rows=FULL, said="count from 1"),
    Case("neuromorphs/tonic#213", "MATLAB: events two structs deep, as AedatTools has them",
         lambda p: make.mat5(p, aedat={"data": {"polarity": columns(VGA, ("timeStamp", "x", "y", "polarity"))}})),
    Case("neuromorphs/tonic#213", "MATLAB: no events in it",
         lambda p: make.mat5(p, pictures=np.zeros((4, 4))), rows=None, said="no events in the MAT-file.*got pictures"),
    Case("losonczylab/sima#181", "MATLAB 7.3: the vectors lie, (1, N)",
         lambda p: make.hdf5(p, group("TD/", {name: one[None] for name, one in columns(VGA, TD_NAMES).items()}))),
    Case("open-mmlab/mmdetection3d#296", "seconds since 1970 as float32",
         lambda p: make.npz(p, **columns(VGA, t=(1.7e9 + VGA.t / 1e6).astype(np.float32))), rows=None,
         said="rounded where the file was written.*steps of 128"),
    Case("own variation", "microseconds as float32 in steps of milliseconds",
         lambda p: make.npz(p, **columns(VGA, t=(2e10 + VGA.t).astype(np.float32))), rows=None, said="too coarse"),
    Case("r00tman/EventNeRF#7", "one time for all events",
         lambda p: make.npz(p, **columns(VGA, t=np.full(len(VGA.t), 5))), rows=VGA._replace(t=0 * VGA.t),
         said="all 2,000 events have one time, 5"),
    Case("own variation", "a portrait sensor in the attributes, which the addresses contradict",
         lambda p: make.hdf5(p, group("events/", columns(WIDE)), width=480, height=640), rows=None,
         said="width and height of the sensor are exchanged; expected 640x480"),
    Case("own variation", "a sensor that stands upright",
         lambda p: make.hdf5(p, group("events/", columns(NARROW)), width=480, height=640), rows=NARROW,
         sensor="480x640", said="higher than wide", needs_size=False),
    Case("own variation", "a unit of time that nobody knows, as an attribute",
         lambda p: make.hdf5(p, group("events/", columns(VGA)), time_unit="ticks"), rows=None,
         said="another unit of time.*'ticks'.*--time-unit"),
    Case("own variation", "such a unit, and what it is",
         lambda p: make.hdf5(p, group("events/", columns(VGA)), time_unit="ticks"),
         options=ImportOptions(time_unit="us"), said="though it says ticks"),
    Case("LAL/trackml-library#10", "an archive of a text",
         lambda p: zipped(p, "events.txt", b"0.1 3 4 1\n"), rows=None, said="without NumPy arrays; got events.txt"),
    Case("own variation", "np.savez that was interrupted",
         lambda p: zipped(p, "t.npy", b""), rows=None, said="holds no array"),
    Case("own variation", "a file that is compressed",
         lambda p: make.write(p, b"\x28\xb5\x2f\xfd" + bytes(40)), rows=None, said="compressed \\(Zstandard\\)"),
    Case("aestream/faery#26", "Event Stream with one event outside the sensor",
         lambda p: make.write(p, make.event_stream(stray(900, VGA.t[900], 5000), 640, 480)),
         said="1 events outside the 640x480 sensor"),
    Case("aestream/faery#26", "Event Stream with 33 bytes of nothing",
         lambda p: make.write(p, *np_split(make.event_stream(VGA, 640, 480), 20, b"\xab" * 33)),
         said="in 1 places are no events"),
    Case("aestream/faery#26", "Event Stream with a block of zeros at its end",
         lambda p: make.write(p, make.event_stream(VGA, 640, 480), bytes(4000)), said="4,000 bytes in 1 places"),
    Case("aestream/faery#26", "Event Stream whose header states a sensor that is too small",
         lambda p: make.write(p, make.event_stream(VGA, 640, 480).replace(struct.pack("<HH", 640, 480),
                                                                          struct.pack("<HH", 320, 480), 1)),
         rows=None, said="expected a sensor of at least 640x480"),
    Case("aestream/faery#26", "the same with the size given",
         lambda p: make.write(p, make.event_stream(VGA, 640, 480).replace(struct.pack("<HH", 640, 480),
                                                                          struct.pack("<HH", 320, 480), 1)),
         given=SensorSize(640, 480)),
    Case("neuromorphs/tonic#143", "N-MNIST cut within an event, with one address of another sensor",
         lambda p: make.write(p, make.nmnist(SMALL.with_row(300, int(SMALL.t[300]), 40, 3, 1)), b"\1\2"),
         rows=SMALL, sensor="34x34", said="the last 2 bytes are not a whole event"),
    Case("neuromorphs/tonic#143", "N-MNIST with one time that steps back",
         lambda p: make.write(p, make.nmnist(SMALL.with_row(300, 0, 3, 3, 1))),
         rows=SMALL, sensor="34x34", said="1 events were left out"),
    # text
    Case("Lynn0306/DVS-Voltmeter#5", "text in seconds, not in the order of time",
         lambda p: make.text(p, make.Rows(*(c[np.argsort(VGA.t // 4000 * 4000 - VGA.y, kind="stable")] for c in VGA)),
                             "{s} {x} {y} {p}"), said="now sorted"),
    Case("SensorsINI/v2e#37", "text whose comment names the columns, y before x",
         lambda p: make.text(p, VGA, "{s} {y} {x} {p}", "#!DVS text", "# t[s] y x polarity")),
    Case("uzh-rpg/rpg_dvs_ros#79", "text in seconds since 1970 with nine digits",
         lambda p: make.text(p, later(VGA, EPOCH_US), "{s}000 {x} {y} {p}"),
         said="seconds are assumed: they count from 1970"),
    Case("prophesee-ai/openeb#111", "text under `% geometry 640x480`, columns x, y, p, t",
         lambda p: make.text(p, VGA, "{x},{y},{p},{t}", "% geometry 640x480"), said="taken for x, y, p, t"),
    Case("microsoft/AirSim#3202", "text x y t p with polarities +1 and -1",
         lambda p: make.text(p, VGA._replace(p=2 * VGA.p - 1), "{x} {y} {t} {p:+d}"), said="taken for x, y, t, p"),
    Case("neuromorphic-paris/loris#7", "CSV of loris: t, x, y, is_increase",
         lambda p: make.text(p, VGA._replace(p=2 * VGA.p - 1), "{t},{x},{y},{p}", "t,x,y,is_on")),
    Case("jmscslgroup/bagpy#15", "CSV of nanoseconds since 1970",
         lambda p: make.text(p, later(VGA, EPOCH_US), "{t}000;{x};{y};{p}", "stamp;x;y;polarity"),
         said="nanoseconds are assumed: they count from 1970"),
    Case("jmscslgroup/bagpy#15", "CSV whose columns are ts_ns, u, v, sign under a remark of another dialect",
         lambda p: make.text(p, VGA, "{t}000,{x},{y},{p}", "// made by a tool", "ts_ns,u,v,sign")),
    Case("pandas-dev/pandas#47303", "CSV whose first line is `sep=|`",
         lambda p: make.text(p, VGA, "{t}|{x}|{y}|{p}", "sep=|", "t_us|x|y|p")),
    Case("pandas-dev/pandas#47303", "CSV under Excel's line `sep=;`, with minus signs of typography",
         lambda p: make.text(p, VGA._replace(p=np.where(VGA.p, "1", "\N{MINUS SIGN}1")), "{t};{x};{y};{p}", "sep=;",
                             "t_us;x;y;p")),
    Case("timeseer-ai/kukur#279", "CSV with decimal commas between commas",
         lambda p: make.text(p, VGA, "0,{t},{x},{y},{p}", "t_s,x,y,p"), rows=None,
         said="more fields than the first line has names"),
    Case("lujiaxuan0520/THU-EACT-50#1", "CSV with one more column that has a name",
         lambda p: make.text(p, VGA, "{t},{x},{y},{p},3", "t_us,x,y,p,cluster"),
         said="the columns cluster are not read"),
    Case("biolab/orange3#7000", "text of UTF-32",
         lambda p: make.text(p, VGA, "{t} {x} {y} {p}", "t_us x y p", encoding="utf-32")),
    Case("git-lfs/git-lfs#4830", "a pointer of Git LFS instead of the file",
         lambda p: make.write(p, b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"),
         rows=None, said="pointer of Git LFS.*git lfs pull"),
    Case("jianing-li/active_event_based_stereo#2", "a web page instead of the file",
         lambda p: make.write(p, b"<!DOCTYPE html><html><body>404</body></html>"), rows=None, said="a web page"),
    Case("VertNet/bels#39", "CSV with a byte-order mark, CRLF, quotes and `True`",
         lambda p: make.text(p, VGA._replace(p=VGA.p == 1), '"{t}","{x}","{y}","{p}"', '"t_us","x","y","p"',
                             encoding="utf-8-sig", newline="\r\n")),
    Case("biolab/orange3#7000", "text of UTF-16 without a mark, separated by tabs",
         lambda p: make.text(p, VGA, "{t}\t{x}\t{y}\t{p}", "t_us\tx\ty\tp", encoding="utf-16-le")),
    Case("timeseer-ai/kukur#279", "text of Latin-1 whose header says [µs]",
         lambda p: make.text(p, VGA, "{t};{x};{y};{p}", "Zeit;t [µs];x;y;p".removeprefix("Zeit;"), encoding="latin-1")),
    Case("microsoft/AirSim#3202", "text whose polarities are the words p and n",
         lambda p: make.text(p, VGA._replace(p=np.where(VGA.p, "p", "n")), "{p} {x} {y} {t}", "polarity x y t_us"),
         said=""),
    Case("microsoft/AirSim#3202", "text whose polarities are words that nobody knows",
         lambda p: make.text(p, VGA._replace(p=np.where(VGA.p, "brighter", "darker")), "{t} {x} {y} {p}"),
         rows=None, said="got brighter, darker; give --polarity"),
    Case("microsoft/AirSim#3202", "the same with the words stated",
         lambda p: make.text(p, VGA._replace(p=np.where(VGA.p, "brighter", "darker")), "{t},{x},{y},{p}", "t,x,y,p"),
         options=ImportOptions(polarity={"brighter": True, "Darker": False})),
    Case("SensorsINI/v2e#47", "text whose -1 wrapped to 18446744073709551615",
         lambda p: make.text(p, VGA._replace(p=UPSIDE.astype(np.uint64)), "{t},{x},{y},{p}", "t_us,x,y,p"),
         said="18446744073709551616 = OFF"),
    Case("lujiaxuan0520/THU-EACT-50#1", "CSV of five columns without names",
         lambda p: make.text(p, VGA, "{y},{x},100,{p},{t}"), rows=None,
         said="the text is not events; expected four numbers"),
    Case("TimoStoff/events_contrast_maximization#12", "text in milliseconds with fractions, no unit named",
         lambda p: make.text(p, VGA._replace(t=VGA.t / 1000), "{t:.3f} {x} {y} {p}"), rows=None,
         said="as seconds the file would be implausibly long.*give --time-unit ms"),
    Case("TimoStoff/events_contrast_maximization#12", "the same with the unit stated",
         lambda p: make.text(p, VGA._replace(t=VGA.t / 1000), "{t:.3f} {x} {y} {p}"), options=ImportOptions("ms")),
    # HDF5
    Case("DachunKai/EvTexture#12", "events/{ps, ts, xs, ys}: bool, float64, int16",
         lambda p: make.hdf5(p, {f"events/{k}s": v for k, v in columns(VGA, t=VGA.t / 1e6, p=VGA.p == 1).items()},
                             sensor_resolution=(480, 640))),
    Case("SensorsINI/v2e#47", "v2e's rows with -1 that wrapped to 4294967295",
         lambda p: make.hdf5(p, {"events": in_order(VGA._replace(p=UPSIDE), "txyp").astype(np.uint32)}),
         said="4294967295 = OFF"),
    Case("SensorsINI/v2e#48", "rows in an HDF5 file in another order, as floats",
         lambda p: make.hdf5(p, {"events": in_order(VGA, "xytp").astype(float)}), said="taken for x, y, t, p"),
    Case("SensorsINI/v2e#41", "v2e's rows with a polarity that is none in one row",
         lambda p: make.hdf5(p, {"events": in_order(stray(900, VGA.t[900])._replace(
             p=np.insert(VGA.p, 900, 9)), "txyp")}), said="1 events were left out"),
    Case("daniilidis-group/m3ed (format)", "M3ED with -1 that wrapped to 255",
         lambda p: m3ed(p, UPSIDE.astype(np.uint8)), said="255 = OFF"),
    Case("daniilidis-group/m3ed (format)", "M3ED whose index says that its times are nanoseconds",
         lambda p: m3ed(p, VGA.p, 1000), said="nanoseconds by their index"),
    Case("SonyResearch/ace_perception_physics (format)", "polarities 1 and 2, stated",
         lambda p: make.hdf5(p, {**group("events/", columns(VGA, p=2 - VGA.p)), "t0": np.array([77])}),
         given=SensorSize(640, 480), options=ImportOptions(polarity={"1": True, "2": False})),
    Case("tallamjr/evlib#57", "Metavision records with -1 that wrapped to 65535",
         lambda p: make.hdf5(p, {"CD/events": records(VGA._replace(p=UPSIDE)).astype(
             [("x", "<u2"), ("y", "<u2"), ("p", "<u2"), ("t", "<i8")])}, geometry=np.bytes_(b"640x480")),
         said="65535 = OFF"),
    Case("tallamjr/evlib#57", "Metavision records with polarities 1 and 2",
         lambda p: make.hdf5(p, {"CD/events": records(VGA._replace(p=VGA.p + 1))}), rows=None, said="give --polarity"),
    Case("eventbasedvision/eTraM#12", "one event at y = 33014",
         lambda p: make.hdf5(p, {f"events/{k}": v for k, v in columns(stray(900, VGA.t[900], 5, 33014)).items()},
                             width=640, height=480), said="1 events outside the 640x480 sensor"),
    Case("tub-rip/events_h52bag#6", "a unit in an attribute that the times contradict",
         lambda p: make.hdf5(p, columns(VGA), time_unit="s", resolution=np.array([640, 480])), rows=None,
         said="cannot be seconds, which the file states"),
    Case("daniilidis-group/m3ed (format)", "M3ED whose cameras are 120 m apart: the calibration is in millimetres",
         lambda p: m3ed_pair(p, 120.0), said="The calibration in the files is left out.*0.12 m"),
    Case("tub-rip/events_h52bag#6", "columns at the root of the file, with the unit in an attribute of the file",
         lambda p: make.hdf5(p, columns(VGA, t=VGA.t * 1000), time_unit="ns", resolution=np.array([640, 480]))),
    Case("uzh-rpg/E-RAFT#2", "DSEC whose 32 bits begin again, with its offset",
         lambda p: make.hdf5(p, {**{f"events/{k}": v for k, v in columns(
             VGA, t=(VGA.t + (1 << 32) - 200_000).astype(np.uint32)).items()},
             "t_offset": np.int64(49_599_300_523), "ms_to_idx": np.arange(3)}), said="the clock began again"),
    Case("uzh-rpg/DSEC#3", "the layout of DSEC whose index says that its times are nanoseconds",
         lambda p: make.hdf5(p, {**group("events/", columns(VGA, t=VGA.t * 1000)), "t_offset": np.int64(0),
                                 "ms_to_idx": np.searchsorted(VGA.t, np.arange(490) * 1000)}),
         said="count nanoseconds by ms_to_idx"),
    Case("mgaoling/mpl_dataset_toolbox#1", "two cameras in groups of one file",
         lambda p: make.hdf5(p, {**group("left/events/", columns(VGA)), **group("right/events/", columns(VGA))}),
         given=SensorSize(640, 480)),
    Case("neuromorphs/tonic#157", "a size that is wrong for a third of the events",
         lambda p: make.hdf5(p, {f"events/{k}": v for k, v in columns(VGA).items()}, width=346, height=260),
         rows=None, said="expected a sensor of at least 640x480"),
    Case("SensorsINI/v2e#47", "polarities that are text of any length",
         lambda p: make.hdf5(p, group("events/", columns(VGA, p=[["off", "ON"][value] for value in VGA.p])),
                             width=640, height=480)),
    Case("eventbasedvision/eTraM#12", "one address beyond the sensor, whose size is not stated",
         lambda p: make.hdf5(p, group("events/", columns(stray(900, VGA.t[900], 705, 9)))), needs_size=False,
         said="1 events outside the 640x480 sensor"),
    # NumPy
    Case("better-flow/evimo#20", "EVIMO with polarities 0 to 3",
         lambda p: make.npz(p, events=in_order(VGA._replace(p=VGA.p + 2 * (VGA.x % 2)), "txyp"),
                            depth=np.zeros((1, 480, 640), np.uint16)), rows=None,
         said="which polarity is ON cannot be told"),
    Case("uzh-rpg/timelens-pp#4", "addresses up to 65534 on a sensor of 970x625",
         lambda p: make.npz(p, **columns(VGA, x=(VGA.x * 102).astype(np.uint16)), width=970, height=625),
         rows=None, said="lie outside the 970x625 sensor"),
    Case("uzh-rpg/rpg_timelens#28", "addresses with fractions, of undistorted events",
         lambda p: make.npz(p, **columns(VGA, x=VGA.x + 0.25, y=VGA.y - 0.25), width=640, height=480),
         said="the nearest pixels are kept"),
    Case("intelpro/CMTA#2", "an array of (4, N)",
         lambda p: make.npy(p, in_order(VGA, "txyp").T), given=SensorSize(640, 480), said="taken for t, x, y, p"),
    Case("neuromorphs/tonic#153", "an array of (N, 4) of p, x, y, t with polarities 0 and 255",
         lambda p: make.npy(p, in_order(VGA._replace(p=255 * VGA.p), "pxyt")), given=SensorSize(640, 480),
         said="taken for p, x, y, t"),
    Case("bamsumit/slayerPytorch#10", "times of NumPy's own kind, in nanoseconds",
         lambda p: make.npz(p, **columns(VGA, t=(VGA.t * 1000).astype("timedelta64[ns]")), width=640, height=480)),
    Case("better-flow/evimo#32", "one time that is the least 64-bit number",
         lambda p: make.npz(p, **columns(VGA, t=np.where(VGA.t == VGA.t[900], -(2**63), VGA.t)), width=640, height=480),
         rows=VGA.without(900), said="1 events were left out"),
    Case("jmscslgroup/bagpy#15", "nanoseconds since 1970, the first of them 0",
         lambda p: make.npz(p, **columns(VGA.with_row(0, -EPOCH_US, 3, 3, 1), t=np.insert(
             1000 * (VGA.t + EPOCH_US), 0, 0)), width=640, height=480),
         said="nanoseconds are assumed: they count from 1970"),
    Case("bamsumit/slayerPytorch#10", "polarities that are the digits 0 and 1 as text",
         lambda p: make.npz(p, **columns(VGA, p=VGA.p.astype(str)), width=640, height=480)),
    Case("own variation", "an array of (N, 4) of text, with words for the polarities that --polarity explains",
         lambda p: make.npy(p, np.stack([*map(np.char.mod, ["%d"] * 3, VGA[:3]), np.where(VGA.p, "rise", "fall")], 1)),
         options=ImportOptions(polarity={"rise": True, "fall": False}), said="taken for t, x, y, p"),
    Case("better-flow/evimo#32", "one time that is no number",
         lambda p: make.npz(p, **columns(VGA, t=np.where(VGA.t == VGA.t[900], np.nan, VGA.t / 1e6)),
                            width=640, height=480),
         rows=VGA.without(900), said="1 events were left out"),
]  # fmt: skip


def np_split(data: bytes, number: int, between: bytes) -> tuple[bytes, bytes, bytes]:
    """The bytes of an Event Stream with others behind so many events of it."""
    at = 20
    for _ in range(number):
        while data[at] == 0xFF:
            at += 1
        at += 5
    return data[:at], between, data[at:]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.report.split('/')[-1]}: {case.what}"[:80])
def test_a_file_of_a_report_is_read_right_or_refused(case, tmp_path):
    path, out = case.write(tmp_path / f"events{case.suffix}"), tmp_path / "out.h5"
    if case.rows is None:
        with pytest.raises(RallyscopeError) as refused:
            import_file([path], out, sensor=case.given, options=case.options)
        assert re.search(case.said, str(refused.value)), str(refused.value)
        assert "\n" not in str(refused.value) and not out.exists()
        return
    sensor = case.given or SensorSize(*map(int, case.sensor.split("x")))
    needs_size = case.needs_size and path.read_bytes()[:1] not in (b"%", b"#", b"E") and case.sensor == "640x480"
    summary = import_file([path], out, sensor=sensor if needs_size else case.given, options=case.options)
    assert case.said in (notes := " | ".join(summary.notes)) or re.search(case.said, notes), notes
    with open_recording(out) as recording:
        for stream in recording.cameras.values():
            found = stream.slice(0, 10**9)
            assert str(stream.sensor) == str(sensor)
            if "bytes of nothing" in case.what:  # how much time passed there is not known
                assert len(found) >= len(case.rows.t) - 2
                np.testing.assert_array_equal(found.x_px[-1900:], case.rows.x[-1900:])
                continue
            for name, column in zip(("t_us", "x_px", "y_px", "on"), case.rows, strict=True):
                within = case.within_us if name == "t_us" else 0
                np.testing.assert_allclose(getattr(found, name), column, rtol=0, atol=within, err_msg=name)


def test_a_folder_from_a_mac_with_hidden_files_is_read(tmp_path):
    """OpenNeuroOrg/openneuro#2520: `._NAME` beside every file, and .DS_Store."""
    folder = tmp_path / "h5" / "evs1"
    folder.mkdir(parents=True)
    items = {**{f"events/{k}": v for k, v in columns(VGA).items()}, "t0": np.array([5])}
    make.hdf5(folder / "seq_001_a.h5", items)
    make.write(folder / "._seq_001_a.h5", b"\x00\x05\x16\x07" + bytes(100))
    make.write(folder / ".DS_Store", b"\x00\x00\x00\x01Bud1")
    make.write(tmp_path / "._tyo.yaml", b"\x00\x05\x16\x07\xff\xfe")
    summary = import_file([folder], tmp_path / "out.h5", sensor=SensorSize(640, 480))
    assert list(summary.events.values()) == [2000]


@pytest.mark.parametrize("name", [b"ev\xff\xfe n.npz", "aufschlag_ü_球.npz".encode()])
def test_a_name_of_any_bytes_is_imported(tmp_path, name):
    """rsnitsch/py3createtorrent#33: a name that is not UTF-8."""
    path = make.npz(Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name)), **columns(VGA), width=640, height=480)
    summary = import_file([path], tmp_path / "out.h5")
    with open_recording(tmp_path / "out.h5") as recording:
        assert len(recording.notes) == len(summary.notes) and "Imported from" in recording.notes[0]
