"""Events, recordings and event files of every format for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import faery
import h5py
import numpy as np
import pytest

from core.events import Events, SensorSize

DAVIS = SensorSize(346, 260)
SOURCE_START_US = 7_000_000


def random_events(count: int, *, seed: int, duration_us: int, sensor: SensorSize, start_us: int = 0) -> Events:
    """Uniformly random events; the first lies at `start_us`, the last `duration_us` - 1 later."""
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.integers(0, duration_us, count))
    x_px, y_px = rng.integers(0, sensor.width_px, count), rng.integers(0, sensor.height_px, count)
    if count:
        t_us[0], t_us[-1] = 0, duration_us - 1
        x_px[0], y_px[0] = sensor.width_px - 1, sensor.height_px - 1
    return Events.from_columns(t_us + start_us, x_px, y_px, rng.integers(0, 2, count).astype(bool), sensor)


def encode_evt21(path: Path, events: Events) -> None:
    """EVT2.1 after the format description: one word an event, coarse times between them, a trigger at the start."""
    words: list[int] = []
    high = -1
    for t, x, y, on in zip(
        *(column.tolist() for column in (events.t_us, events.x_px, events.y_px, events.on)), strict=True
    ):
        if t >> 6 != high:
            high = t >> 6
            words.append(8 << 60 | high << 32)
            if len(words) == 1:
                words.append(0xA << 60 | (t & 63) << 54 | 3 << 40 | 1 << 32)
        group = x & ~31
        words.append(int(on) << 60 | (t & 63) << 54 | group << 43 | y << 32 | 1 << (x - group))
    header = f"% evt 2.1\n% format EVT21;height={events.sensor.height_px};width={events.sensor.width_px}\n% end\n"
    path.write_bytes(header.encode() + np.array(words, "<u8").tobytes())


def _write_with_faery(path: Path, events: Events, suffix: str, **options: str) -> None:
    records = np.empty(len(events), faery.EVENTS_DTYPE)
    records["t"], records["x"], records["y"], records["on"] = events.t_us, events.x_px, events.y_px, events.on
    size = (events.sensor.width_px, events.sensor.height_px)
    written = path.with_name(path.name + suffix)
    faery.events_stream_from_array(records, size).to_file(written, zero_t0=False, **options)  # pyright: ignore[reportArgumentType]
    written.rename(path)


def _write_metavision(path: Path, events: Events) -> None:
    records = np.empty(len(events), [("x", "<u2"), ("y", "<u2"), ("p", "<i2"), ("t", "<i8")])
    records["t"], records["x"], records["y"], records["p"] = events.t_us, events.x_px, events.y_px, events.on
    with h5py.File(path, "w") as file:
        file["CD/events"] = records
        file.attrs["geometry"] = str(events.sensor)


def _write_columns(path: Path, events: Events, group: str, names: str, *, seconds: bool) -> None:
    with h5py.File(path, "w") as file:
        t = events.t_us / 1e6 if seconds else events.t_us
        for name, column in zip(names.split(), (t, events.x_px, events.y_px, events.on), strict=True):
            file.create_dataset(f"{group}/{name}", data=column, compression="lzf")


def _write_dsec(path: Path, events: Events) -> None:
    start_us = int(events.t_us[0])
    with h5py.File(path, "w") as file:
        columns = (("x", events.x_px), ("y", events.y_px), ("p", events.on.astype("u1")))
        for name, column in (*columns, ("t", (events.t_us - start_us).astype("u4"))):
            file.create_dataset(f"events/{name}", data=column, compression="gzip", chunks=True)
        file["ms_to_idx"] = np.searchsorted(events.t_us - start_us, np.arange(0, events.t_us[-1] - start_us, 1000))
        file["t_offset"] = np.int64(start_us)
        file.attrs.update(width=events.sensor.width_px, height=events.sensor.height_px)


def _write_mvsec(path: Path, events: Events) -> None:
    rows = np.stack([events.x_px, events.y_px, events.t_us / 1e6, np.where(events.on, 1, -1)], axis=1)
    with h5py.File(path, "w") as file:
        file.create_dataset("davis/left/events", data=rows, dtype="f8")


def _write_text(path: Path, events: Events, header: str, order: str, separator: str) -> None:
    columns = {"t": events.t_us, "x": events.x_px, "y": events.y_px, "p": events.on.astype(int), "s": events.t_us / 1e6}
    table = np.stack([columns[name] for name in order], axis=1)
    numbers = ["%.6f" if name == "s" else "%d" for name in order]
    np.savetxt(path, table, fmt=numbers, delimiter=separator, header=header, comments="")


FORMATS: dict[str, Callable[[Path, Events], None]] = {
    "evt2": lambda path, events: _write_with_faery(path, events, ".raw", version="evt2"),
    "evt2.1": encode_evt21,
    "evt3": lambda path, events: _write_with_faery(path, events, ".raw", version="evt3"),
    "dat": lambda path, events: _write_with_faery(path, events, ".dat", version="dat2"),
    "aedat4": lambda path, events: _write_with_faery(path, events, ".aedat4"),
    "es": lambda path, events: _write_with_faery(path, events, ".es"),
    "metavision": _write_metavision,
    "dsec": _write_dsec,
    "mvsec": _write_mvsec,
    "xs_ys_ts_ps": lambda path, events: _write_columns(path, events, "events", "ts xs ys ps", seconds=True),
    "raw_events": lambda path, events: _write_columns(path, events, "raw_events", "t x y p", seconds=False),
    "npz": lambda path, events: np.savez(
        path.open("wb"), t=events.t_us, x=events.x_px, y=events.y_px, p=events.on.astype(np.int8) * 2 - 1
    ),
    "csv": lambda path, events: _write_text(path, events, "x,y,polarity,timestamp", "xypt", ","),
    "text": lambda path, events: _write_text(path, events, "", "sxyp", " "),
}


@pytest.fixture
def make_events():
    """The function `random_events`."""
    return random_events


@pytest.fixture(params=sorted(FORMATS))
def foreign(request, tmp_path):
    """A file of each format, its name saying nothing, and the events in it (on its own clock)."""
    events = random_events(30_000, seed=5, duration_us=300_000, sensor=DAVIS, start_us=SOURCE_START_US)
    path = tmp_path / f"recording_{request.param}"
    FORMATS[request.param](path, events)
    return request.param, path, events


@pytest.fixture
def write_foreign():
    """The function (format, path, events) that writes such a file."""

    def write(name: str, path: Path, events: Events) -> Path:
        FORMATS[name](path, events)
        return path

    return write


@pytest.fixture(scope="session")
def shared_events(shared_data) -> Path:
    """The folder of real event files."""
    return shared_data / "events"
