"""Training pictures on disk, a file per background; a resumed training reuses them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.detection.yolo.letterbox import shrink
from core.errors import ConfigError, RecordingError
from core.files import read_json, replacing, write_json
from core.learning.detector_training.config import DetectorTrainingConfig
from core.learning.detector_training.rooms import LabelledPictures, render_room
from core.recordings import open_recording
from core.recordings.reader import FileRecording

SETTINGS_FILE: Final = "pictures.json"
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, eq=False)
class TrainingPictures:
    """Groups of pictures, each of one size; their bytes stay on disk until they are looked at."""

    groups: tuple[LabelledPictures, ...]

    def __len__(self) -> int:
        return sum(len(group.images) for group in self.groups)

    def rows(self) -> NDArray[np.int64]:
        """(N, 2): group and row in it of every picture."""
        rows = [[number, row] for number, group in enumerate(self.groups) for row in range(len(group.images))]
        return np.array(rows, np.int64).reshape(-1, 2)

    def part(self, first: int, last: int) -> TrainingPictures:
        """Groups from `first` up to, not including, `last`."""
        return TrainingPictures(self.groups[first:last])


def rendered_pool(
    folder: Path,
    config: DetectorTrainingConfig,
    progress: Progress = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> TrainingPictures:
    """Render the rooms that the folder has not yet; those so far when cancelled.

    Raises:
        ConfigError: if the folder has the pictures of other settings.
    """
    _claim(folder, config)
    for number in range(config.rooms):
        if cancelled():
            break
        images, circles = _paths(folder, number)
        if not circles.exists():
            pictures = render_room(config, number)
            for path, array in (
                (images, pictures.images),
                (circles, pictures.circles),
            ):  # circles last
                with replacing(path, durable=False) as partial, partial.open("wb") as file:
                    np.save(file, array)
        progress((number + 1) / config.rooms)
    there = [_paths(folder, number) for number in range(config.rooms)]
    return TrainingPictures(
        tuple(
            LabelledPictures(np.load(images, mmap_mode="r"), np.load(circles))
            for images, circles in there
            if circles.exists()
        )
    )


def data_set_pool(
    data: Path, config: DetectorTrainingConfig, progress: Progress = lambda share: None
) -> TrainingPictures:
    """The pictures of the recordings in a folder, with the ball where the recording says it is; one group a camera.

    Raises:
        RecordingError: if no recording has pictures and knows where the ball is.
    """
    paths = sorted(data.glob("*.h5"))
    groups: list[LabelledPictures] = []
    for number, path in enumerate(paths):
        with open_recording(path) as recording:
            if isinstance(recording, FileRecording):
                groups += _labelled(recording, config)
        progress((number + 1) / len(paths))
    if not groups:
        remedy = "`rallyscope simulate --preset paper7 --out FOLDER` makes such recordings"
        expected = "recordings (*.h5) with frames and the truth"
        raise RecordingError("no pictures to train on", expected=expected, where=data, remedy=remedy)
    return TrainingPictures(tuple(groups))


def _labelled(recording: FileRecording, config: DetectorTrainingConfig) -> Iterator[LabelledPictures]:
    size = config.yolo.input_width_px, config.yolo.input_height_px
    for name, frames in recording.frames.items():
        truth = recording.cameras[name].truth if name in recording.cameras else None
        if truth is None or not len(frames):
            continue
        at = truth.at(frames.t_us)
        small = [shrink(frames.image(row), *size) for row in range(len(frames))]
        scales = np.array([scale for _, scale in small])
        circles = np.column_stack([at.u_px + 0.5, at.v_px + 0.5, at.r_px]) * scales[:, None]
        yield LabelledPictures(np.stack([image for image, _ in small]), circles)


def _claim(folder: Path, config: DetectorTrainingConfig) -> None:
    mine = {
        "seed": config.seed,
        "frames_per_room": config.frames_per_room,
        "input": [config.yolo.input_width_px, config.yolo.input_height_px],
    }
    path = folder / SETTINGS_FILE
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_json(path, mine)
    elif (there := read_json(path)) != mine:
        remedy = "remove the folder, or write the weights elsewhere"
        raise ConfigError(
            "these are the pictures of another training", expected=json.dumps(mine), got=json.dumps(there),
            where=folder, remedy=remedy,
        )  # fmt: skip


def _paths(folder: Path, number: int) -> tuple[Path, Path]:
    return folder / f"room-{number:05d}-images.npy", folder / f"room-{number:05d}-circles.npy"
