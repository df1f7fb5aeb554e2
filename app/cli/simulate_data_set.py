"""`rallyscope simulate` with lists or a preset: a data set in a folder."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping

from app.cli.arguments import given
from app.cli.backend_arguments import SharedBackendArguments
from app.cli.progress import progress_bar
from app.cli.simulate_arguments import SERVES, DataSetArguments, SimulateArguments
from app.cli.terminal import say
from core.cameras.presets import PRESETS as CAMERA_PRESETS
from core.cameras.presets import SENSOR_720
from core.data_sets import CARD, PRESETS, DataSetPlan, DataSetRun, plan_data_set, preset_plan, run_data_set
from core.data_sets.plan import PAPER_SPEEDS_MPS, Making
from core.errors import CommandError


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
    _refuse(single, "is of a single recording; a data set takes --speeds and --scenes")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise CommandError("a data set is a folder", got="a file", where=arguments.out)
    plan, engine = _plan(arguments), arguments.engine.engine()
    with progress_bar(f"Simulating {len(plan.recordings)} recordings") as progress:
        done = run_data_set(plan, arguments.out, engine=engine, overwrite=arguments.force, progress=progress)
    report = {"folder": str(done.folder), "made": done.made, "kept": done.kept, "total": done.manifest["total"]}
    say(json.dumps(report) if arguments.json else _describe(done))


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


def _describe(done: DataSetRun) -> str:
    total = done.manifest["total"]
    assert isinstance(total, dict)
    kept = f", {len(done.kept)} were there" if done.kept else ""
    return (
        f"{done.folder}: {len(done.made)} recordings made{kept}; {total['seconds']:.1f} s, {total['events']:,} events\n"
        f"truths: {total['centres_2d']:,} ball centres in the pictures, {total['points_3d']:,} in the world, "
        f"{total['frames_with_ball']:,} of {total['frames']:,} frames with a ball; see {done.folder / CARD}"
    )


def _refuse(values: Mapping[str, object], why: str) -> None:
    for name in given(values):
        raise CommandError(why, where=f"--{name}")
