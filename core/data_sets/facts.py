"""What a recording of a data set holds, counted in the file itself."""

from __future__ import annotations

import hashlib
import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from core.cameras.presets import camera_preset
from core.data_sets.plan import PlannedRecording
from core.data_sets.robot_recording import record_robot
from core.errors import RecordingError
from core.files import replacing
from core.history.recorded_rally import EPISODES, RACKET
from core.live.worlds.world import WorldConfig
from core.physics.config import physics_profile
from core.physics.episode import Case
from core.physics.task import task_profile
from core.recordings import open_recording
from core.recordings.reader import FileRecording
from core.simulation import LaunchConfig, StereoConfig, simulate_recording
from core.simulation.recording import READOUT
from core.text import parse_json

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
    cameras = camera_preset(planned.placement, making.sensor)
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


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """Counts and rates of one camera."""

    events: int
    centres: int
    """Truth samples, every 0.5 ms, at which the ball can be seen."""
    frames: int
    frames_with_ball: int
    """Pictures at whose mid exposure it can be seen."""
    delayed: int
    dropped: int
    """Events that the readout delayed and lost."""


@dataclass(frozen=True, slots=True)
class RecordingFacts:
    """Counts and outcomes of one recording."""

    name: str
    uuid: str
    sha256: str
    """SHA-256 of the file's bytes when it was made."""
    duration_us: int
    bytes: int
    cameras: dict[str, CameraFacts]
    points_3d: int
    """Samples, every 0.5 ms, of the ball in the world."""
    points_3d_seen: int
    """Those at which every camera sees the ball."""
    episodes: int
    returned: int
    racket_poses: int


def read_facts(path: Path, planned: PlannedRecording, sha256: str = "") -> RecordingFacts:
    """Count what is in a recording; its digest is computed unless it is known.

    Raises:
        RecordingError: if it was made with other settings than those planned, or cannot be read.
    """
    _check_settings(path, planned)
    return count_facts(path, planned.name, sha256)


def count_facts(path: Path, name: str, sha256: str = "") -> RecordingFacts:
    """Count what is in a recording of this name; its digest is computed unless it is known.

    Raises:
        RecordingError: if it cannot be read.
    """
    with open_recording(path) as recording:
        cameras = {name: _camera_facts(recording, name) for name in recording.cameras}
        ball, rows = recording.ball, recording.read_rows(EPISODES)
        racket = recording.read_rows(RACKET)
        truths = [stream.truth for stream in recording.cameras.values() if stream.truth is not None]
        # At the times of the ball: cameras whose truth is of labels have times of their own.
        times_us = np.zeros(0, np.int64) if ball is None else ball.t_us
        seen = np.all([one.at(times_us).visible for one in truths], axis=0) if truths else np.zeros(0, np.bool_)
        return RecordingFacts(
            name=name,
            uuid=recording.uuid,
            sha256=sha256 or file_sha256(path),
            duration_us=recording.duration_us,
            bytes=path.stat().st_size,
            cameras=cameras,
            points_3d=0 if ball is None else int(ball.visible.sum()),
            points_3d_seen=int(seen.sum()),
            episodes=0 if rows is None else len(rows["case"]),
            returned=0 if rows is None else int((rows["case"] == Case.RETURNED).sum()),
            racket_poses=0 if racket is None else len(racket["t_us"]),
        )


def file_sha256(path: Path) -> str:
    """Hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _camera_facts(recording: FileRecording, name: str) -> CameraFacts:
    stream, frames, rows = recording.cameras[name], recording.frames.get(name), recording.read_rows(f"{READOUT}/{name}")
    truth = stream.truth
    with_ball = 0 if frames is None or truth is None else int(truth.at(frames.t_us).visible.sum())
    return CameraFacts(
        events=stream.event_count,
        centres=0 if truth is None else int(truth.visible.sum()),
        frames=0 if frames is None else len(frames),
        frames_with_ball=with_ball,
        delayed=0 if rows is None else int(rows["delayed"].sum()),
        dropped=0 if rows is None else int(rows["dropped"].sum()),
    )


def _check_settings(path: Path, planned: PlannedRecording) -> None:
    remedy = "choose another folder, the same settings, or --force"
    try:
        with h5py.File(path, "r") as file:
            made = parse_json(str(file.attrs.get("config", "{}"))).get(REMARK)
    except (OSError, ValueError) as error:
        raise RecordingError("not a whole recording", where=path, remedy="remove it, or --force") from error
    if not isinstance(made, dict):
        raise RecordingError("was not made as part of a data set", where=path, remedy=remedy)
    for key, expected in planned.settings.items():
        if made.get(key) != expected:
            raise RecordingError(
                f"was made with another {key}", expected=expected, got=made.get(key), where=path, remedy=remedy
            )
