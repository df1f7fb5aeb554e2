"""`rallyscope simulate`: balls seen by simulated event cameras, with ground truth, as a recording or a data set."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import ClassVar

from app.cli.arguments import Names, Numbers, PositiveInt, flag, given, setting_flag
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.cameras import Sensor, named_cameras
from app.cli.constants import CONSTANTS_HELP, given_constants
from app.cli.progress import Progress, progress_bar
from app.cli.terminal import say
from core.cameras.presets import CORNERS, PLACEMENTS, SENSOR_720
from core.cameras.presets import PRESETS as CAMERA_PRESETS
from core.data_sets import CARD, PRESETS, DataSetPlan, DataSetRun, plan_data_set, preset_plan, run_data_set
from core.data_sets.plan import PAPER_SPEEDS_MPS, Making
from core.data_sets.robot_recording import record_robot
from core.errors import CommandError
from core.live.worlds.world import WorldConfig
from core.physics.config import Profile, physics_profile
from core.physics.task import HIT_RULES, HitRule, task_profile
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording
from core.simulation.frames import FrameConfig
from core.simulation.recording import SimulatedRecording
from core.simulation.scenes.scene import SCENES, SceneConfig, scene_named
from core.text import counted

DEFAULT = "ball"


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneArguments:
    """`--scene` and what may be changed of it."""

    scene: str | None = flag("what the cameras look at", "|".join(SCENES), DEFAULT)
    wall: float | None = flag("brightness of the walls (the scene's: 0.16 or 0.7)", "0..1")
    flicker: float | None = setting_flag(SceneConfig, "flicker", "DEPTH")
    flicker_hz: float | None = setting_flag(SceneConfig, "flicker_hz", "HZ", "frequency of the flicker")

    def config(self) -> SceneConfig:
        """The scene that was asked for.

        Raises:
            ConfigError: if there is no such scene or a value is out of bounds.
        """
        return dataclasses.replace(scene_named(self.scene or DEFAULT), **self.changes())

    def changes(self) -> dict[str, float]:
        """What of a scene was asked to be otherwise."""
        return given({"wall": self.wall, "flicker": self.flicker, "flicker_hz": self.flicker_hz})


SERVES = 3
"""Serves of a recording, by default."""
SPEEDS = ",".join(f"{speed:g}" for speed in PAPER_SPEEDS_MPS)


@dataclass(frozen=True, slots=True, kw_only=True)
class DataSetArguments:
    """What makes a data set of it, and what goes with that only."""

    TITLE: ClassVar = "data sets: a folder of recordings; lists are comma-separated"
    speeds: Numbers | None = flag("serve speeds; a recording for each", "MPS,MPS...", SPEEDS)
    scenes: Names | None = flag("scenes; every speed is simulated in each", "SCENE,SCENE...", "ball")
    recordings_per: PositiveInt | None = flag("recordings per scene and speed", "N", 1)
    preset: str | None = flag("predefined data set, instead of these lists", "|".join(PRESETS))

    @property
    def asked(self) -> bool:
        """Whether there is a list or a preset."""
        return any(asked is not None for asked in (self.speeds, self.scenes, self.preset))


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulateArguments:
    """Make a recording, or a data set, with the simulated event cameras."""

    out: Path = flag("the recording, or data set, to make", "REC.h5|DIR")
    serves: PositiveInt | None = flag("serves in the recording", "N", SERVES)
    speed: float | None = setting_flag(LaunchConfig, "speed_mps", "MPS")
    scene: SceneArguments
    cameras: str | None = flag(
        "camera placement, or a calibration file", f"{'|'.join(PLACEMENTS)}|{CORNERS}|FILE", "side"
    )
    noise_hz: float | None = setting_flag(SensorConfig, "noise_hz", "HZ")
    sensor: Sensor | None = flag("sensor size of a placement's cameras", "WxH", SENSOR_720)
    physics: Profile | None = flag("flight of the ball", "paper|real", "paper")
    constants: Path | None = flag(CONSTANTS_HELP, "FILE")
    robot: bool | None = flag(
        "let the robot, which knows every ball, play it: racket and episodes are recorded (data sets: on)"
    )
    hit: HitRule | None = flag(
        "where the robot meets balls: chosen, where each can best be met; paper, at the plane 5 cm behind the table",
        "|".join(HIT_RULES),
        "paper",
        choices=HIT_RULES,
    )
    frames_hz: float | None = flag("take colour pictures too, at this rate", "HZ", within=(FrameConfig, "rate_hz"))
    exposure_us: int | None = setting_flag(FrameConfig, "exposure_us", "N", "exposure of the colour pictures")
    seed: int = flag("random seed; the same seed gives the same events", "N", 0)
    force: bool = flag("overwrite what is there")
    json: bool = flag("print what was made as JSON")
    data_set: DataSetArguments
    engine: SharedBackendArguments

    def frames(self) -> FrameConfig | None:
        """The pictures that were asked for, if any.

        Raises:
            CommandError: if there is an exposure and no rate.
            ConfigError: if the numbers are impossible.
        """
        if self.frames_hz is not None:
            return dataclasses.replace(
                FrameConfig(), rate_hz=self.frames_hz, **given({"exposure_us": self.exposure_us})
            )
        if self.exposure_us is not None and self.data_set.preset is None:
            raise CommandError("an exposure without pictures", remedy="give --frames-hz too", where="--exposure-us")
        return None


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
            hit=arguments.hit or "paper",
        )
    if arguments.hit is not None:
        raise CommandError("nobody hits a ball", got="--hit", remedy="give --robot too", where="--hit")
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
    events = ", ".join(f"{name} {count:,}" for name, count in made.events.items())
    frames = f", {counted(made.frames, 'frame')}" if made.frames else ""
    line = f"{made.path}: {counted(made.serves, 'serve')}, {made.duration_us / 1e6:.3f} s, events: {events}{frames}"
    dropped = (
        f"the readout of {name} dropped {counted(count, 'event')}" for name, count in made.dropped.items() if count
    )
    return "\n".join([line, *dropped])


def refuse_data_set_arguments(asked: DataSetArguments, engine: SharedBackendArguments) -> None:
    """For a single recording.

    Raises:
        CommandError: if there are arguments that make sense for data sets only.
    """
    only = {"recordings-per": asked.recordings_per, "jobs": engine.jobs, "cluster": engine.cluster}
    _refuse(only, "goes with --speeds, --scenes or --preset")


def run_data_sets(arguments: SimulateArguments) -> None:
    """Make the data set, and say what was made."""
    single = {"speed": arguments.speed, "scene": arguments.scene.scene, "constants": arguments.constants}
    single["hit"] = arguments.hit
    _refuse(single, "is of a single recording; a data set takes --speeds and --scenes")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise CommandError("a data set is a folder", got="a file", where=arguments.out)
    plan, engine = _plan(arguments), arguments.engine.engine()
    with progress_bar(f"Simulating {counted(len(plan.recordings), 'recording')}") as progress:
        done = run_data_set(plan, arguments.out, engine=engine, overwrite=arguments.force, progress=progress)
    report = {"folder": str(done.folder), "made": done.made, "kept": done.kept, "total": done.manifest["total"]}
    say(json.dumps(report) if arguments.json else _describe_data_set(done))


def _plan(arguments: SimulateArguments) -> DataSetPlan:
    asked, frames = arguments.data_set, arguments.frames()
    making = Making(
        sensor=arguments.sensor or SENSOR_720,
        noise_hz=arguments.noise_hz,
        physics=arguments.physics or "paper",
        frames=frames,
        **arguments.scene.changes(),
    )
    if asked.preset is not None:
        lists = {"speeds": asked.speeds, "scenes": asked.scenes, "recordings-per": asked.recordings_per}
        others = {"cameras": arguments.cameras, "serves": arguments.serves, "robot": arguments.robot}
        _refuse({**lists, **others}, "is what a preset says itself")
        if frames is None and asked.preset in PRESETS:
            own = dataclasses.replace(PRESETS[asked.preset][1], **given({"exposure_us": arguments.exposure_us}))
            making = dataclasses.replace(making, frames=own)
        return preset_plan(asked.preset, arguments.seed, making)
    placements = [name.strip() for name in (arguments.cameras or "side").split(",")]
    if unknown := [name for name in placements if name not in CAMERA_PRESETS]:
        expected = f"placements: {', '.join(CAMERA_PRESETS)}"
        raise CommandError("no such cameras for a data set", expected=expected, got=repr(unknown[0]), where="--cameras")
    return plan_data_set(
        speeds_mps=asked.speeds or PAPER_SPEEDS_MPS,
        scenes=asked.scenes or ("ball",),
        placements=placements,
        recordings_per=asked.recordings_per or 1,
        serves=arguments.serves or SERVES,
        robot=arguments.robot is not False,
        seed=arguments.seed,
        making=making,
    )


def _describe_data_set(done: DataSetRun) -> str:
    total = done.manifest["total"]
    assert isinstance(total, dict)
    kept = f", {len(done.kept)} were there" if done.kept else ""
    return (
        f"{done.folder}: {counted(len(done.made), 'recording')} made{kept}; {total['seconds']:.1f} s, "
        f"{counted(total['events'], 'event')}\n"
        f"truths: {total['centres_2d']:,} ball centres in the pictures, {total['points_3d']:,} in the world, "
        f"{total['frames_with_ball']:,} of {total['frames']:,} frames with a ball; see {done.folder / CARD}"
    )


def _refuse(values: Mapping[str, object], why: str) -> None:
    for name in given(values):
        raise CommandError(why, where=f"--{name}")
