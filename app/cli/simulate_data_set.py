"""`rallyscope simulate` with lists or a preset: a data set in a folder."""

from __future__ import annotations

import argparse
import dataclasses
import json

from app.cli.arguments import positive_int
from app.cli.progress import progress_bar
from app.cli.scenes import scene_changes
from core.cameras.presets import PLACEMENTS, SENSOR_720
from core.errors import CommandError
from core.rally.data_sets import CARD, PRESETS, DataSetPlan, DataSetRun, plan_data_set, preset_plan, run_data_set
from core.rally.data_sets.plan import PAPER_SPEEDS_MPS, Making
from core.simulation.frames.frames import FrameConfig

SERVES = 3


def add_data_set_arguments(group: argparse._ArgumentGroup) -> None:
    """The arguments of data sets."""
    speeds = ",".join(f"{speed:g}" for speed in PAPER_SPEEDS_MPS)
    group.add_argument("--speeds", type=_speeds, metavar="MPS,MPS...", help=f"a recording each (default: {speeds})")
    group.add_argument("--scenes", type=_names, metavar="SCENE,SCENE...", help="every speed in each (default: ball)")
    group.add_argument("--recordings-per", type=positive_int, metavar="N", help="of every scene and speed (default: 1)")
    group.add_argument("--preset", metavar="|".join(PRESETS), help="a data set with a name, instead of lists")
    group.add_argument(
        "--jobs", type=positive_int, metavar="N", help="recordings made at a time (default: one per core)"
    )


def asks_for_data_set(arguments: argparse.Namespace) -> bool:
    """Whether there is a list or a preset."""
    return any(getattr(arguments, name) is not None for name in ("speeds", "scenes", "preset"))


def refuse_data_set_arguments(arguments: argparse.Namespace) -> None:
    """For a single recording.

    Raises:
        CommandError: if there are arguments that make sense for data sets only.
    """
    _refuse(arguments, ("recordings_per", "jobs"), "goes with --speeds, --scenes or --preset")


def run_data_sets(arguments: argparse.Namespace, frames: FrameConfig | None) -> None:
    """Make the data set, and say what was made."""
    _refuse(arguments, ("speed", "scene"), "is of a single recording; a data set takes --speeds and --scenes")
    if arguments.out.exists() and not arguments.out.is_dir():
        raise CommandError("a data set is a folder", got="a file", where=arguments.out)
    plan = _plan(arguments, frames)
    with progress_bar(f"Simulating {len(plan.recordings)} recordings") as progress:
        done = run_data_set(plan, arguments.out, jobs=arguments.jobs, overwrite=arguments.force, progress=progress)
    if arguments.json:
        text = {"folder": str(done.folder), "made": done.made, "kept": done.kept, "total": done.manifest["total"]}
        print(json.dumps(text))
    else:
        _tell(done)


def _plan(arguments: argparse.Namespace, frames: FrameConfig | None) -> DataSetPlan:
    making = Making(
        sensor=arguments.sensor or SENSOR_720,
        noise_hz=arguments.noise_hz,
        physics=arguments.physics,
        frames=frames,
        **scene_changes(arguments),
    )
    if arguments.preset is not None:
        says = "is what a preset says itself"
        _refuse(arguments, ("speeds", "scenes", "recordings_per", "cameras", "serves", "robot"), says)
        if frames is None and arguments.preset in PRESETS:
            own = PRESETS[arguments.preset][1]
            if arguments.exposure_us is not None:
                own = dataclasses.replace(own, exposure_us=arguments.exposure_us)
            making = dataclasses.replace(making, frames=own)
        return preset_plan(arguments.preset, arguments.seed, making)
    placements = _names(arguments.cameras or "side")
    if unknown := [name for name in placements if name not in PLACEMENTS]:
        expected = f"placements: {', '.join(PLACEMENTS)}"
        raise CommandError("no such cameras for a data set", expected=expected, got=repr(unknown[0]), where="--cameras")
    return plan_data_set(
        speeds_mps=arguments.speeds or PAPER_SPEEDS_MPS,
        scenes=arguments.scenes or ("ball",),
        placements=placements,
        recordings_per=arguments.recordings_per or 1,
        serves=arguments.serves or SERVES,
        robot=arguments.robot is not False,
        seed=arguments.seed,
        making=making,
    )


def _tell(done: DataSetRun) -> None:
    total = done.manifest["total"]
    assert isinstance(total, dict)
    kept = f", {len(done.kept)} were there" if done.kept else ""
    print(
        f"{done.folder}: {len(done.made)} recordings made{kept}; {total['seconds']:.1f} s, {total['events']:,} events"
    )
    print(
        f"truths: {total['centres_2d']:,} ball centres in the pictures, {total['points_3d']:,} in the world, "
        f"{total['frames_with_ball']:,} of {total['frames']:,} frames with a ball; see {done.folder / CARD}"
    )


def _refuse(arguments: argparse.Namespace, names: tuple[str, ...], why: str) -> None:
    for name in names:
        if getattr(arguments, name) is not None:
            raise CommandError(why, where=f"--{name.replace('_', '-')}")


def _names(text: str) -> tuple[str, ...]:
    """Names between commas."""
    names = tuple(part.strip() for part in text.split(","))
    if not all(names):
        raise argparse.ArgumentTypeError(f"expected names between commas, got {text!r}")
    return names


def _speeds(text: str) -> tuple[float, ...]:
    """Numbers between commas."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected numbers between commas, such as 5,6,7, got {text!r}") from None
