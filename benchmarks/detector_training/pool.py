"""Training pictures on disk, a file per background; a resumed training reuses them.

Rendered training pictures with random backgrounds, cameras, balls and exposures. The pictures come from the colour
cameras of the simulation, so that people, rackets, shadows and blur look as they do in recordings. A room is drawn from
the training's seed and its own number; recordings have other seeds.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.presets import DISTORTION, FOCAL_PX, PLACEMENTS, SENSOR_720
from core.detection.yolo.config import DetectorTrainingConfig
from core.detection.yolo.letterbox import shrink
from core.errors import ConfigError, RecordingError
from core.files import read_json, replacing, write_json
from core.geometry import look_at
from core.physics.config import PhysicsConfig
from core.recordings import open_recording
from core.recordings.reader import FileRecording
from core.simulation import LaunchConfig, SceneConfig, pixel_truth
from core.simulation.bodies import make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.flights import FlightSeries
from core.simulation.frames import BallColour, FrameCamera, FrameConfig
from core.simulation.scenes.scene import ActorsName

ROOMS_STREAM: Final = 0x726F6F6D
"""Random stream, separate from the seeds of recordings and from the training's other draws."""
CASTS: Final[tuple[tuple[ActorsName, float], ...]] = (
    ("nobody", 0.40), ("person", 0.20), ("two-persons", 0.20), ("rally", 0.15), ("head", 0.05),
)  # fmt: skip
"""Moving persons, and their shares of the backgrounds."""
REFLECTANCES: Final[dict[str, tuple[float, float]]] = {
    "ball": (0.3, 1.0), "table": (0.06, 0.45), "line": (0.6, 0.95), "floor": (0.05, 0.6), "wall": (0.06, 0.7),
    "net": (0.03, 0.15), "net_cover": (0.2, 0.45), "racket": (0.02, 0.15), "ambient": (0.4, 0.9), "shadow": (0.1, 0.6),
    "edge_px": (1.2, 2.4),
}  # fmt: skip
"""Between which values of `SceneConfig` rooms are drawn; a ball as dark as in the scene `dark` is not among them."""
ORANGE_SHARE: Final = 0.75
EXPOSURE_US: Final = (300, 15_000)
RATE_HZ: Final = 60.0
"""Allows the longest exposure; the pictures of a room are taken at any time."""
NOISE: Final = (1e-4, 4e-3)
CAMERA_MOVES_M, TARGET_MOVES_M, FOCAL_SHARE = 0.3, 0.2, (0.8, 1.25)
WITHOUT_BALL: Final = 0.1
"""Share of a room's pictures that are taken when no ball is in sight, if there is such a time."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPictures:
    """N pictures of one size, the input's scale, and the ball in each."""

    images: NDArray[np.uint8]
    """(N, h, w, 3)"""
    circles: NDArray[np.float64]
    """(N, 3): centre and radius in pixels from the picture's corner, the middle of the first pixel 0.5; nan without."""


def render_room(config: DetectorTrainingConfig, number: int) -> LabelledPictures:
    """The pictures of a room; the same seed and number give the same ones."""
    rng = np.random.default_rng([config.seed, ROOMS_STREAM, number])
    scene, camera = draw_scene(rng), draw_camera(rng)
    launch = LaunchConfig(speed_mps=float(rng.uniform(3.0, 9.0)), yaw_spread_deg=4.0, side_spread_m=0.6)
    if scene.cast == "rally":
        launch = dataclasses.replace(launch, speed_mps=min(launch.speed_mps, 6.0))
    flights, strokes = draw_flights(scene, [launch], rng, PhysicsConfig())
    bodies = make_actors(scene.cast, int(rng.integers(2**31)), strokes)
    frames = FrameConfig(
        rate_hz=RATE_HZ,
        exposure_us=EXPOSURE_US[1],
        gamma=float(rng.uniform(1.8, 2.6)),
        read_noise=float(_log_uniform(rng, *NOISE)),
        ball_colour=_draw_colour(rng),
    )
    taker = FrameCamera(camera, scene, frames, rng, bodies)
    times_us = _draw_times(rng, camera, flights, config.frames_per_room)
    truth = pixel_truth(camera, flights, times_us, bodies)
    images, circles = [], []
    for row, t_us in enumerate(times_us.tolist()):
        exposure_us = round(_log_uniform(rng, *EXPOSURE_US))
        image = taker.take(flights, None, t_us, exposure_us=exposure_us)
        small, scale = shrink(image, config.yolo.input_width_px, config.yolo.input_height_px)
        images.append(small)
        centre_px = (float(truth.u_px[row]) + 0.5, float(truth.v_px[row]) + 0.5, float(truth.r_px[row]))
        circles.append([scale * value for value in centre_px])
    return LabelledPictures(np.stack(images), np.array(circles))


def draw_scene(rng: np.random.Generator) -> SceneConfig:
    """Random scene with its persons."""
    cast = CASTS[int(rng.choice(len(CASTS), p=[share for _, share in CASTS]))][0]
    values = {name: float(rng.uniform(low, high)) for name, (low, high) in REFLECTANCES.items()}
    return SceneConfig(cast=cast, **values)


def draw_camera(rng: np.random.Generator) -> Camera:
    """Random camera: a preset place, slightly moved and turned, with a random lens."""
    at, target = PLACEMENTS[str(rng.choice(list(PLACEMENTS)))]
    side = np.array([1.0, rng.choice([-1.0, 1.0]), 1.0])
    position = np.array(at) * side + rng.uniform(-CAMERA_MOVES_M, CAMERA_MOVES_M, 3)
    aim = np.array(target) * side + rng.uniform(-TARGET_MOVES_M, TARGET_MOVES_M, 3)
    focal = FOCAL_PX * rng.uniform(*FOCAL_SHARE)
    sensor = SENSOR_720
    K = np.array([[focal, 0, (sensor.width_px - 1) / 2], [0, focal, (sensor.height_px - 1) / 2], [0, 0, 1]])
    return Camera(sensor, K, np.array(DISTORTION), look_at(tuple(position), tuple(aim)))


def _draw_colour(rng: np.random.Generator) -> BallColour:
    return "orange" if rng.random() < ORANGE_SHARE else "white"


def _draw_times(rng: np.random.Generator, camera: Camera, flights: FlightSeries, count: int) -> NDArray[np.int64]:
    """Ascending times (count,), most of them with the ball in sight: the camera's noise is drawn in their order."""
    longest_us = EXPOSURE_US[1]
    every_us = np.arange(longest_us, max(longest_us + 1, int(flights.end_s * 1e6) - longest_us), 1000)
    seen = pixel_truth(camera, flights, every_us).visible
    with_ball, without = every_us[seen], every_us[~seen]
    wanted = rng.random(count) >= WITHOUT_BALL
    chosen = [
        int(rng.choice(with_ball if (ball and len(with_ball)) or not len(without) else without)) for ball in wanted
    ]
    return np.sort(np.array(chosen, np.int64))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


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
