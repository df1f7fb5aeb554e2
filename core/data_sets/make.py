"""Make one recording of a data set. It appears under its name only when it is whole."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

from core.cameras import stereo_preset
from core.data_sets.plan import PlannedRecording
from core.data_sets.robot_recording import record_robot
from core.files import replacing
from core.live.worlds.world import WorldConfig
from core.physics.config import physics_profile
from core.physics.task import task_profile
from core.simulation import LaunchConfig, StereoConfig, simulate_recording

REMARK = "data_set"
"""Where the config in a recording says by which settings it was made."""


def recording_path(folder: Path, planned: PlannedRecording) -> Path:
    """Path of the finished recording."""
    return folder / f"{planned.name}.h5"


def partial_path(folder: Path, planned: PlannedRecording) -> Path:
    """Path of the recording while this process writes it; a process presumed dead may still write another."""
    return folder / f".{planned.name}.{socket.gethostname()}-{os.getpid()}.partial.h5"


def remove_partials(folder: Path) -> None:
    """Take away what a run that was killed has left."""
    for path in folder.glob(".*.partial.h5*"):
        path.unlink(missing_ok=True)


def make_recording(
    planned: PlannedRecording, folder: Path, progress: Callable[[float], None] = lambda share: None
) -> None:
    """Simulate it on one thread and put it into the folder, replacing what has its name.

    Raises:
        RecordingError: if it cannot be written.
        ConfigError: if there is no such serve.
    """
    partial = partial_path(folder, planned)
    with replacing(recording_path(folder, planned), durable=True, partial=partial):
        _simulate(planned, partial, progress)


def _simulate(planned: PlannedRecording, path: Path, progress: Callable[[float], None]) -> None:
    making, remarks = planned.making, {REMARK: planned.settings}
    stereo = StereoConfig(scene=making.scene_config(planned.scene), sensor=making.sensor_config())
    cameras = stereo_preset(planned.placement, making.sensor)
    if planned.robot:
        record_robot(
            path,
            WorldConfig(task=task_profile(making.physics), stereo=stereo),
            cameras,
            planned.speeds_mps,
            seed=planned.seed,
            frames=making.frames,
            threads=1,
            uuid=planned.uuid,
            remarks=remarks,
            overwrite=True,
            progress=progress,
        )
        return
    simulate_recording(
        path,
        stereo,
        cameras,
        [LaunchConfig(speed_mps=speed_mps) for speed_mps in planned.speeds_mps],
        seed=planned.seed,
        physics=physics_profile(making.physics),
        frames=making.frames,
        threads=1,
        uuid=planned.uuid,
        remarks=remarks,
        overwrite=True,
        progress=progress,
    )
