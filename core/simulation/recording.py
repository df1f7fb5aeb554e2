"""Simulated recordings: serves seen by event cameras, with the truth, written as a recording file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from core.cameras import Camera, stereo_preset
from core.config import config_to_mapping
from core.files import replacing
from core.physics.config import PhysicsConfig
from core.recordings import RecordingWriter
from core.simulation.bodies import make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.event_cameras.event_camera import StereoConfig, simulate_stereo
from core.simulation.flights import BallPath, LaunchConfig
from core.simulation.frames import FrameConfig, FrameTrack
from core.simulation.scenes.racket_view import RacketPath
from core.simulation.scenes.scene import SceneConfig
from core.simulation.sensor.readout import ReadoutCounts
from core.simulation.truth import ball_truth, pixel_truth, truth_times

DEMO_SERVES_MPS: Final = (5.0, 4.0, 6.0, 5.0)
"""Launch speeds of the demo's serves."""
DEMO_SEED: Final = 20
READOUT: Final = "/readout"
"""The group with what each camera's readout did."""


@dataclass(frozen=True, slots=True)
class SimulatedRecording:
    """What a simulation wrote to a file."""

    path: Path
    duration_us: int
    serves: int
    events: dict[str, int]
    """Per camera."""
    truths: int
    """Times at which the ball is visible, over all cameras."""
    delayed: dict[str, int]
    """Per camera: events that waited for the readout for a microsecond or more."""
    dropped: dict[str, int]
    """Per camera: events that the readout lost; a note in the recording says so."""
    frames: int
    """Pictures, over all cameras."""
    finished: bool
    """False where it was cancelled: everything up to then is in the file."""


def simulate_recording(
    path: Path,
    config: StereoConfig,
    cameras: Mapping[str, Camera],
    serves: list[LaunchConfig],
    *,
    seed: int,
    physics: PhysicsConfig | None = None,
    frames: FrameConfig | None = None,
    threads: int | None = None,
    uuid: str | None = None,
    remarks: Mapping[str, object] | None = None,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> SimulatedRecording:
    """Write the events and the truth of some serves, one after the other. The same seed gives the same events.

    The physics is that of the paper unless told otherwise. With `frames` every camera takes pictures too, which changes
    nothing in the events. The cameras work in `threads` threads, one each unless told otherwise. `remarks` join the
    config in the recording.

    Args:
        path: the file.
        config: scene and sensor.
        cameras: lens and pose, by name.
        serves: launches, one after the other.
        seed: of launches and noise.
        physics: None: the paper's.
        frames: pictures that are taken too.
        threads: of the cameras.
        uuid: identity of the recording; None: a new one.
        remarks: added to its config.
        overwrite: whether a file there may be replaced.
        progress: gets the share that is done.
        cancelled: is asked after every chunk.

    Raises:
        RecordingError: if the file exists and `overwrite` is not set, or it cannot be written.
        ConfigError: if there is no such serve.
    """
    physics = physics or PhysicsConfig()
    flights, strokes = draw_flights(config.scene, serves, np.random.default_rng(seed), physics)
    bodies = make_actors(config.scene.cast, seed, strokes)
    resolved = {
        **config_to_mapping(config),
        "serves": [config_to_mapping(serve) for serve in serves],
        "physics": config_to_mapping(physics),
        **frames_mapping(frames),
        **(remarks or {}),
    }
    track = None if frames is None else FrameTrack(cameras, config.scene, frames, seed, bodies)
    sensors = {name: camera.sensor for name, camera in cameras.items()}
    end_us, pictures, finished = 0, 0, True
    readout: dict[str, ReadoutCounts] = {}
    wanted_us = flights.end_s * 1e6
    with RecordingWriter(
        path, sensors, calibration=cameras, seed=seed, config=resolved, uuid=uuid, overwrite=overwrite
    ) as writer:
        for chunk in simulate_stereo(config, cameras, flights, seed=seed, bodies=bodies, threads=threads):
            if cancelled():
                finished = False
                break
            for name, events in chunk.events.items():
                writer.append(name, events)
            end_us, readout = chunk.end_us, chunk.readout
            pictures += write_frames(writer, track, end_us, flights)
            progress(min(1.0, end_us / wanted_us))
        # Only now: a recording that was cancelled has truth as far as it has events.
        times_us = truth_times(flights, 0, end_us)
        writer.write_ball(ball_truth(flights, times_us))
        truths = 0
        for name, camera in cameras.items():
            truth = pixel_truth(camera, flights, times_us, bodies)
            truths += int(truth.visible.sum())
            writer.write_truth(name, truth)
        writer.extend_duration(end_us)
        write_readout(writer, readout)
        counts = {name: writer.event_count(name) for name in cameras}
    delayed = {name: counted.delayed for name, counted in readout.items()}
    dropped = {name: counted.dropped for name, counted in readout.items()}
    return SimulatedRecording(path, end_us, len(serves), counts, truths, delayed, dropped, pictures, finished)


def frames_mapping(frames: FrameConfig | None) -> dict[str, object]:
    """How pictures were taken, for the config in a recording; nothing without pictures."""
    return {} if frames is None else {"frames": config_to_mapping(frames)}


def write_frames(
    writer: RecordingWriter, track: FrameTrack | None, end_us: int, path: BallPath, racket: RacketPath | None = None
) -> int:
    """Take and write the pictures whose exposure is over at `end_us`; returns how many, over all cameras."""
    written = 0
    if track is None:
        return 0
    for t_us, images in track.take_until(end_us, path, racket):
        for name, image in images.items():
            writer.write_frames(name, np.array([t_us]), np.array([track.config.exposure_us]), image[None])
            written += 1
    return written


def write_readout(writer: RecordingWriter, readout: Mapping[str, ReadoutCounts]) -> None:
    """What each camera's readout did to the events, as rows, and as a note where some were lost."""
    for name, counted in readout.items():
        writer.append_rows(
            f"{READOUT}/{name}",
            {
                "delayed": np.array([counted.delayed]),
                "dropped": np.array([counted.dropped]),
                "longest_us": np.array([counted.longest_us]),
            },
        )
        if counted.dropped:
            writer.note(f"the readout of {name} dropped {counted.dropped:,} events")


def ensure_demo(path: Path, progress: Callable[[float], None] = lambda share: None) -> None:
    """Make the demo recording if it is not there yet: four serves, two calibrated 1280x720 cameras at the side.

    It appears under its name only once it is whole.
    """
    if path.exists():
        return
    serves = [LaunchConfig(speed_mps=speed, yaw_spread_deg=2.0) for speed in DEMO_SERVES_MPS]
    config = StereoConfig(scene=SceneConfig())
    with replacing(path, durable=True) as partial:
        simulate_recording(partial, config, stereo_preset(), serves, seed=DEMO_SEED, overwrite=True, progress=progress)
