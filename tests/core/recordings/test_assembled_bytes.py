"""A finished recording is the same file whatever else goes on in the process."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from core.cameras import stereo_preset
from core.events import Events
from core.recordings import RecordingWriter


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
