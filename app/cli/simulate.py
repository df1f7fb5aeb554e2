"""`rallyscope simulate`: balls seen by simulated event cameras, with ground truth, as a recording or a data set."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

from app.cli.arguments import given
from app.cli.cameras import named_cameras
from app.cli.constants import given_constants
from app.cli.progress import Progress, progress_bar
from app.cli.simulate_arguments import SERVES, SimulateArguments
from app.cli.simulate_data_set import refuse_data_set_arguments, run_data_sets
from app.cli.terminal import say
from core.data_sets.robot_recording import record_robot
from core.errors import CommandError
from core.live.worlds.world import WorldConfig
from core.physics.config import physics_profile
from core.physics.task import task_profile
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from core.simulation.recording import SimulatedRecording

LARGEST_SEED = 2**63 - 1
"""The recording keeps the seed in 64 bits."""


def run(arguments: SimulateArguments) -> None:
    """Simulate, and say what was made."""
    if not 0 <= arguments.seed <= LARGEST_SEED:
        expected = f"a whole number from 0 to {LARGEST_SEED}"
        raise CommandError("no such seed", expected=expected, got=arguments.seed, where="--seed")
    if arguments.data_set.asked:
        run_data_sets(arguments)
        return
    refuse_data_set_arguments(arguments.data_set, arguments.engine)
    with progress_bar(f"Simulating {arguments.out.name}") as progress:
        made = _simulate(arguments, progress)
    say(json.dumps({**asdict(made), "path": str(made.path)}) if arguments.json else _describe(made))


def _simulate(arguments: SimulateArguments, progress: Progress) -> SimulatedRecording:
    frames = arguments.frames()
    constants = given_constants(arguments.constants, arguments.physics)
    sensor = replace(SensorConfig(), **given({"noise_hz": arguments.noise_hz}))
    config = StereoConfig(scene=arguments.scene.config(), sensor=sensor)
    cameras = named_cameras(arguments.cameras or "side", arguments.sensor)
    serves = [replace(LaunchConfig(), **given({"speed_mps": arguments.speed}))] * (arguments.serves or SERVES)
    if arguments.robot:
        world = WorldConfig(task=task_profile(arguments.physics or "paper", constants), stereo=config)
        return record_robot(
            arguments.out,
            world,
            cameras,
            [serve.speed_mps for serve in serves],
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
        physics=physics_profile(arguments.physics or "paper") if constants is None else constants.physics(),
        frames=frames,
        overwrite=arguments.force,
        progress=progress,
    )


def _describe(made: SimulatedRecording) -> str:
    noun = "serve" if made.serves == 1 else "serves"
    events = ", ".join(f"{name} {count:,}" for name, count in made.events.items())
    frames = f", {made.frames:,} frames" if made.frames else ""
    line = f"{made.path}: {made.serves} {noun}, {made.duration_us / 1e6:.3f} s, events: {events}{frames}"
    dropped = (f"the readout of {name} dropped {count:,} events" for name, count in made.dropped.items() if count)
    return "\n".join([line, *dropped])
