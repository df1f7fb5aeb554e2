"""`rallyscope simulate`: balls seen by simulated event cameras, with ground truth, as a recording or a data set."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from app.cli.arguments import positive_int
from app.cli.cameras import named_cameras, sensor_size
from app.cli.progress import Progress, progress_bar
from app.cli.scenes import add_scene_arguments, scene_of
from app.cli.simulate_data_set import (
    add_data_set_arguments,
    asks_for_data_set,
    refuse_data_set_arguments,
    run_data_sets,
)
from core.cameras.presets import PLACEMENTS
from core.errors import CommandError
from core.physics.config import physics_profile
from core.physics.task import task_profile
from core.rally.data_sets.robot_recording import record_robot
from core.rally.simulated.world import WorldConfig
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from core.simulation.frames.frames import FrameConfig
from core.simulation.recording import SimulatedRecording

LARGEST_SEED = 2**63 - 1
"""The recording keeps the seed in 64 bits."""
SERVES = 3
"""Of a recording, unless told otherwise."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    presets = "|".join(PLACEMENTS)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="REC.h5|DIR", help="the recording, or data set, to make"
    )
    parser.add_argument("--serves", type=positive_int, metavar="N", help=f"of a recording (default: {SERVES})")
    parser.add_argument("--speed", type=float, metavar="MPS", help="launch speed, 3 to 9 (default: 5)")
    add_scene_arguments(parser)
    parser.add_argument("--cameras", metavar=f"{presets}|FILE", help="placement, or a calibration file (default: side)")
    parser.add_argument("--noise-hz", type=float, metavar="HZ", help="background events per pixel and second (0.1)")
    parser.add_argument(
        "--sensor", type=sensor_size, metavar="WxH", help="of a placement's cameras (default: 1280x720)"
    )
    parser.add_argument("--physics", default="paper", metavar="paper|real", help="flight of the ball (default: paper)")
    parser.add_argument(
        "--robot",
        action=argparse.BooleanOptionalAction,
        help="let the robot, which knows every ball, play it: racket and episodes are recorded (data sets: on)",
    )
    parser.add_argument("--frames-hz", type=float, metavar="HZ", help="take colour pictures too, at this rate")
    parser.add_argument("--exposure-us", type=int, metavar="N", help="of the pictures (default: 5000)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0; the same seed, the same events")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    parser.add_argument("--json", action="store_true", help="print what was made as JSON")
    add_data_set_arguments(parser.add_argument_group("data sets: a folder of recordings; lists are comma-separated"))


def run(arguments: argparse.Namespace) -> None:
    """Simulate, and say what was made."""
    if arguments.physics not in ("paper", "real"):
        raise CommandError("no such physics", expected="paper or real", got=repr(arguments.physics), where="--physics")
    if not 0 <= arguments.seed <= LARGEST_SEED:
        expected = f"a whole number from 0 to {LARGEST_SEED}"
        raise CommandError("no such seed", expected=expected, got=arguments.seed, where="--seed")
    frames = frame_config(arguments)
    if asks_for_data_set(arguments):
        run_data_sets(arguments, frames)
        return
    refuse_data_set_arguments(arguments)
    with progress_bar(f"Simulating {arguments.out.name}") as progress:
        made = _simulate(arguments, frames, progress)
    if arguments.json:
        print(json.dumps({**dataclasses.asdict(made), "path": str(made.path)}))
    else:
        _tell(made)


def frame_config(arguments: argparse.Namespace) -> FrameConfig | None:
    """The pictures that were asked for, if any.

    Raises:
        CommandError: if there is an exposure and no rate.
        ConfigError: if the numbers are impossible.
    """
    if arguments.frames_hz is None:
        if arguments.exposure_us is not None and arguments.preset is None:
            raise CommandError("an exposure without pictures", remedy="give --frames-hz too", where="--exposure-us")
        return None
    exposure = {} if arguments.exposure_us is None else {"exposure_us": arguments.exposure_us}
    return FrameConfig(rate_hz=arguments.frames_hz, **exposure)


def _simulate(arguments: argparse.Namespace, frames: FrameConfig | None, progress: Progress) -> SimulatedRecording:
    noise = {} if arguments.noise_hz is None else {"noise_hz": arguments.noise_hz}
    config = StereoConfig(scene=scene_of(arguments), sensor=SensorConfig(**noise))
    cameras = named_cameras(arguments.cameras or "side", arguments.sensor)
    count, speed_mps = arguments.serves or SERVES, 5.0 if arguments.speed is None else arguments.speed
    serves = [LaunchConfig(speed_mps=speed_mps)] * count
    if arguments.robot:
        world = WorldConfig(task=task_profile(arguments.physics), stereo=config)
        return record_robot(
            arguments.out,
            world,
            cameras,
            [speed_mps] * count,
            seed=arguments.seed,
            frames=frames,
            overwrite=arguments.force,
            progress=progress,
        )
    return simulate_recording(
        arguments.out,
        config,
        cameras,
        serves,
        seed=arguments.seed,
        physics=physics_profile(arguments.physics),
        frames=frames,
        overwrite=arguments.force,
        progress=progress,
    )


def _tell(made: SimulatedRecording) -> None:
    noun = "serve" if made.serves == 1 else "serves"
    events = ", ".join(f"{name} {count:,}" for name, count in made.events.items())
    frames = f", {made.frames:,} frames" if made.frames else ""
    print(f"{made.path}: {made.serves} {noun}, {made.duration_us / 1e6:.3f} s, events: {events}{frames}")
    for name, dropped in made.dropped.items():
        if dropped:
            print(f"the readout of {name} dropped {dropped:,} events")
