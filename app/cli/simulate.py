"""`rallyscope simulate`: serves seen by simulated event cameras, with ground truth, as a recording."""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from app.cli.arguments import positive_int
from app.cli.cameras import named_cameras, sensor_size
from app.cli.progress import progress_bar
from app.cli.scenes import add_scene_arguments, scene_of
from core.cameras.presets import PLACEMENTS
from core.errors import CommandError
from core.simulation import SensorConfig, ServeConfig, StereoConfig, simulate_recording
from core.simulation.physics.config import physics_profile

LARGEST_SEED = 2**63 - 1
"""The recording keeps the seed in 64 bits."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    presets = "|".join(PLACEMENTS)
    parser.add_argument("--out", type=Path, required=True, metavar="REC.h5", help="the recording to make")
    parser.add_argument("--serves", type=positive_int, default=3, metavar="N", help="default: %(default)s")
    parser.add_argument("--speed", type=float, default=5.0, metavar="MPS", help="launch speed, 3 to 9 (default: 5)")
    add_scene_arguments(parser)
    parser.add_argument("--cameras", default="side", metavar=f"{presets}|FILE", help="placement, or a calibration file")
    parser.add_argument("--noise-hz", type=float, metavar="HZ", help="background events per pixel and second (0.1)")
    parser.add_argument(
        "--sensor", type=sensor_size, metavar="WxH", help="of a placement's cameras (default: 1280x720)"
    )
    parser.add_argument("--physics", default="paper", metavar="paper|real", help="flight of the ball (default: paper)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0; the same seed, the same events")
    parser.add_argument("--force", action="store_true", help="replace REC.h5 if it exists")
    parser.add_argument("--json", action="store_true", help="print what was made as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Simulate, and say what was made."""
    if arguments.physics not in ("paper", "real"):
        raise CommandError("no such physics", expected="paper or real", got=repr(arguments.physics), where="--physics")
    if not 0 <= arguments.seed <= LARGEST_SEED:
        expected = f"a whole number from 0 to {LARGEST_SEED}"
        raise CommandError("no such seed", expected=expected, got=arguments.seed, where="--seed")
    noise = {} if arguments.noise_hz is None else {"noise_hz": arguments.noise_hz}
    config = StereoConfig(scene=scene_of(arguments), sensor=SensorConfig(**noise))
    cameras = named_cameras(arguments.cameras, arguments.sensor)
    serves = [ServeConfig(speed_mps=arguments.speed)] * arguments.serves
    with progress_bar(f"Simulating {arguments.out.name}") as progress:
        made = simulate_recording(
            arguments.out,
            config,
            cameras,
            serves,
            seed=arguments.seed,
            physics=physics_profile(arguments.physics),
            overwrite=arguments.force,
            progress=progress,
        )
    if arguments.json:
        print(json.dumps({**dataclasses.asdict(made), "path": str(made.path)}))
    else:
        noun = "serve" if made.serves == 1 else "serves"
        events = ", ".join(f"{name} {count:,}" for name, count in made.events.items())
        print(f"{made.path}: {made.serves} {noun}, {made.duration_us / 1e6:.3f} s, events: {events}")
        for name, dropped in made.dropped.items():
            if dropped:
                print(f"the readout of {name} dropped {dropped:,} events")
