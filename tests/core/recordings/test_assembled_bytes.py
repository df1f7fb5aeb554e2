"""A finished recording is the same file whatever else goes on in the process."""

import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from core.cameras import stereo_preset
from core.events import Events
from core.recordings import RecordingWriter
from core.recordings.blocks import CHUNK_EVENTS, pack_column, shuffle_bytes, unpack_column


def write(path: Path) -> bytes:
    cameras = stereo_preset()
    sensors = {name: camera.sensor for name, camera in cameras.items()}
    with RecordingWriter(path, sensors, calibration=cameras, uuid="5f6f1d3e-53f4-4f0e-8f5b-0d6a2d1c9a70") as writer:
        for name, sensor in sensors.items():
            t_us = np.arange(0, 200_000, 100, dtype=np.int64)
            x = (t_us % 640).astype(np.uint16)
            writer.append(name, Events(t_us, x, x // 2, t_us % 200 == 0, sensor))
    return path.read_bytes()


def test_objects_that_somebody_holds_on_to_move_nothing_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = write(tmp_path / "alone.h5")
    held, create = [], h5py.Group.create_dataset

    def create_and_hold(*arguments: object, **more: object) -> h5py.Dataset:
        held.append(create(*arguments, **more))
        return held[-1]

    monkeypatch.setattr(h5py.Group, "create_dataset", create_and_hold)
    assert write(tmp_path / "held.h5") == alone and len(held) > 10


def test_short_columns_are_deflated_by_zlib_as_isa_l_does_them_in_two_ways() -> None:
    """The last digits of two poses in six columns of doubles: ISA-L made 42 or 45 bytes of such, by the process."""
    poses = np.random.default_rng(3).normal(size=(2, 3))
    assert pack_column(poses, 2) == zlib.compress(shuffle_bytes(poses).tobytes(), 1)
    events = np.arange(CHUNK_EVENTS, dtype=np.uint16) % 300
    by_zlib = zlib.compress(shuffle_bytes(events).tobytes(), 1)
    assert pack_column(events, CHUNK_EVENTS) != by_zlib, "events go through ISA-L: it is fast"
    for column in (poses, events):
        packed = pack_column(column, len(column))
        assert np.array_equal(unpack_column(packed, column.dtype, column.shape), column)
