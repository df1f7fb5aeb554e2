"""What is at work when a fault comes: each kind of work that writes, small, as the verb or the module that does it."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.labels.durability import LAYER, STEP_US, UUID, trial_label
from core.config import load_config, save_config
from core.data_sets.run import LOCK
from core.detection import DetectorConfig
from core.errors import RallyscopeError
from core.events import Events, SensorSize
from core.learning.agents.policy import read_policy
from core.learning.config import CurriculumConfig, RunConfig
from core.learning.runs.checkpoints import load_checkpoint
from core.learning.runs.run_files import load_policy, read_lines, read_run, seed_files
from core.recordings import RecordingWriter, open_recording
from labels.store import LabelStore, Layer

SENSOR: Final = SensorSize(640, 480)
BATCH: Final = 7001
BATCHES: Final = 60
IMPORTED: Final = 120_000
LABELS: Final = 150
EPISODES: Final = 20
CHECKPOINT_EVERY: Final = 5
SMALL: Final = ("--sensor", "320x240", "--serves", "1")


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultJob:
    """One kind of work. `inputs` is a folder that trials only read, `out` the empty folder of one trial."""

    name: str
    prepare: Callable[[Path], None]
    """Make the inputs."""
    work: Callable[[Path, Path], int]
    """Do it, say on standard output what is acknowledged, and return the exit code."""
    again: Callable[[Path, Path], int]
    """What a person does next, in the folder that the fault has left."""
    lost: Callable[[Path, Path, str], int]
    """How much that was acknowledged, or that has a final name, is not there or not whole; `said` is the output.

    Raises:
        RallyscopeError: one clear line; nothing was lost only if nothing was acknowledged.
    """
    whole: Callable[[Path, Path], bool]
    """Whether all that the work makes is there."""
    workers: bool = False
    """Processes of its own work for it."""
    sqlite: bool = False
    """SQLite writes, which Python does not see."""


def _verb(*arguments: object) -> int:
    return int(importlib.import_module("app.cli.main").main([str(argument) for argument in arguments]))


def _no_inputs(inputs: Path) -> None:
    pass


def _last_number(said: str) -> int:
    """Of the whole lines of a process that may have been killed."""
    return max((int(line) for line in said.split("\n")[:-1] if line.isdigit()), default=0)


def _record(inputs: Path, out: Path) -> int:
    with RecordingWriter(out / "a.h5", {"left": SENSOR, "right": SENSOR}, overwrite=True) as writer:
        for done in range(0, BATCHES * BATCH, BATCH):
            rows = np.arange(done, done + BATCH)
            events = Events.from_columns(rows * 3, rows % 640, rows % 480, rows % 3 == 0, SENSOR)
            writer.append("left", events)
            writer.append("right", events)
            writer.flush()
            print(done + BATCH, flush=True)  # noqa: T201 (it tells its parent)
    return 0


def _recorded(out: Path) -> int:
    if not (out / "a.h5").exists():
        return 0
    with open_recording(out / "a.h5") as recording:
        return min(len(camera.slice(0, recording.duration_us)) for camera in recording.cameras.values())


def _write_csv(inputs: Path) -> None:
    rows = np.arange(IMPORTED)
    table = np.column_stack([rows * 3, rows % 640, rows % 480, rows % 2])
    np.savetxt(inputs / "events.csv", table, "%d", ",", header="t,x,y,p", comments="")


def _import(inputs: Path, out: Path) -> int:
    return _verb("import", inputs / "events.csv", out / "a.h5")


def _import_again(inputs: Path, out: Path) -> int:
    return _verb("import", inputs / "events.csv", out / "a.h5", "--force")


def _import_lost(inputs: Path, out: Path, said: str) -> int:
    """One that is cut short says so in its notes, and is opened with what was written."""
    if not (out / "a.h5").exists():
        return int(bool(said.strip()))
    with open_recording(out / "a.h5") as recording:
        events = sum(camera.event_count for camera in recording.cameras.values())
        stopped = any("stopped before it closed" in note for note in recording.notes)
    return int(events < IMPORTED and not stopped)


def _imported_whole(inputs: Path, out: Path) -> bool:
    with open_recording(out / "a.h5") as recording:
        return sum(camera.event_count for camera in recording.cameras.values()) == IMPORTED


def _label(inputs: Path, out: Path) -> int:
    with LabelStore.open(out, UUID, LAYER.camera, LAYER.annotator) as store:
        for index in range(len(store.labels()), LABELS):
            store.put(trial_label(index))
            print(index + 1, flush=True)  # noqa: T201 (it tells its parent)
    return 0


def _labelled(out: Path) -> set[int]:
    if not Layer(UUID, LAYER.camera, LAYER.annotator).path(out).exists():
        return set()
    return {label.t_us for label in LabelStore.read(out, LAYER).all()}


def _label_lost(inputs: Path, out: Path, said: str) -> int:
    found = _labelled(out) if _last_number(said) else set()
    return sum(index * STEP_US not in found for index in range(_last_number(said)))


def _prepare_training(inputs: Path) -> None:
    curriculum = CurriculumConfig(speeds_mps=(3.0,), episodes=(EPISODES,))
    save_config(
        RunConfig(curriculum=curriculum, checkpoint_every=CHECKPOINT_EVERY, evaluation_balls=5), inputs / "run.toml"
    )


def _train(inputs: Path, out: Path) -> int:
    return _verb("train", "--out", out / "run", "--config", inputs / "run.toml")


def _train_again(inputs: Path, out: Path) -> int:
    begun = (out / "run" / "config.toml").exists()
    return _verb("train", "--out", out / "run", "--resume") if begun else _train(inputs, out)


def _train_lost(inputs: Path, out: Path, said: str) -> int:
    """What has its name is whole, and a checkpoint lies behind every kept policy but one."""
    files = seed_files(out / "run", 0)
    kept = list(files.folder.glob("policies/*.safetensors"))
    if kept:
        read_run(out / "run")
    for path in (*kept, *(path for path in (files.policy, files.best) if path.exists())):
        read_policy(path)
    episode = int(str(load_checkpoint(files.checkpoint)[1]["episode"])) if files.checkpoint.exists() else 0
    return max(0, len(kept) - 1 - episode // CHECKPOINT_EVERY)


def _trained_whole(inputs: Path, out: Path) -> bool:
    lines, _ = read_lines(seed_files(out / "run", 0).metrics)
    return [line["episode"] for line in lines] == list(range(EPISODES)) and load_policy(out / "run") is not None


def _prepare_recording(inputs: Path) -> None:
    if _verb("simulate", "--out", inputs / "rec.h5", *SMALL):
        raise RuntimeError("the recording for the trials cannot be made")
    if _export(inputs, inputs / "clean"):
        raise RuntimeError("the export for the trials cannot be made")


def _export(inputs: Path, out: Path) -> int:
    return _verb("export", inputs / "rec.h5", "--csv", out / "tables")


def _export_again(inputs: Path, out: Path) -> int:
    return _verb("export", inputs / "rec.h5", "--csv", out / "tables", "--force")


def _contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*") if path.is_file() and path.name[0] != "."}


def _differ(folder: str, suffix: str = "") -> Callable[[Path, Path, str], int]:
    """Counts the files in a folder that are not as those of a clean run, which the inputs hold."""

    def lost(inputs: Path, out: Path, said: str) -> int:
        clean = _contents(inputs / "clean" / folder)
        left = _contents(out / folder)
        return sum(clean.get(name) != data for name, data in left.items() if name.endswith(suffix))

    return lost


def _same(folder: str) -> Callable[[Path, Path], bool]:
    """Whether a folder holds what that of a clean run holds, and nothing unfinished beside it."""

    def whole(inputs: Path, out: Path) -> bool:
        left = [path for path in (out / folder).glob(".*") if path.name != LOCK]
        return _contents(inputs / "clean" / folder) == _contents(out / folder) and not left

    return whole


def _data_set(inputs: Path, out: Path, jobs: int = 1) -> int:
    small = ("--sensor", "48x32", "--serves", "1", "--cameras", "behind", "--no-robot", "--jobs", jobs)
    return _verb("simulate", "--out", out / "set", "--speeds", "8,9", *small)


def _prepare_data_set(inputs: Path) -> None:
    if _data_set(inputs, inputs / "clean"):
        raise RuntimeError("the data set for the trials cannot be made")


def _tune(inputs: Path, out: Path, jobs: int = 1) -> int:
    names = "geometry.circularity_min,localise.radius_min_px"
    less = ("--camera", "left", "--trials", "4", "--jobs", jobs, "--parameters", names)
    return _verb("tune", inputs / "rec.h5", "--out", out / "found.toml", *less)


def _tune_lost(inputs: Path, out: Path, said: str) -> int:
    if (out / "found.toml").exists():
        load_config(DetectorConfig, out / "found.toml")
    return int("the config:" in said and not (out / "found.toml").exists())


DATA_SET: Final = FaultJob(
    name="data set",
    prepare=_prepare_data_set,
    work=_data_set,
    again=_data_set,
    lost=_differ("set", ".h5"),
    whole=_same("set"),
)
TUNE: Final = FaultJob(
    name="tune",
    prepare=_prepare_recording,
    work=_tune,
    again=_tune,
    lost=_tune_lost,
    whole=lambda inputs, out: _tune_lost(inputs, out, "the config:") == 0,
)


def _in_parallel(job: FaultJob, act: Callable[..., int]) -> FaultJob:
    """The same by two workers."""
    by_two = partial(act, jobs=2)
    return replace(job, name=f"{job.name} in parallel", work=by_two, again=by_two, workers=True)


JOBS: Final = {
    job.name: job
    for job in (
        FaultJob(
            name="recording",
            prepare=_no_inputs,
            work=_record,
            again=_record,
            lost=lambda inputs, out, said: max(0, _last_number(said) - _recorded(out)) if _last_number(said) else 0,
            whole=lambda inputs, out: _recorded(out) == BATCHES * BATCH,
        ),
        FaultJob(
            name="import",
            prepare=_write_csv,
            work=_import,
            again=_import_again,
            lost=_import_lost,
            whole=_imported_whole,
        ),
        FaultJob(
            name="labelling",
            prepare=_no_inputs,
            work=_label,
            again=_label,
            lost=_label_lost,
            whole=lambda inputs, out: len(_labelled(out)) == LABELS,
            sqlite=True,
        ),
        FaultJob(
            name="training",
            prepare=_prepare_training,
            work=_train,
            again=_train_again,
            lost=_train_lost,
            whole=_trained_whole,
        ),
        FaultJob(
            name="export",
            prepare=_prepare_recording,
            work=_export,
            again=_export_again,
            lost=_differ("tables"),
            whole=_same("tables"),
        ),
        DATA_SET,
        TUNE,
        _in_parallel(DATA_SET, _data_set),
        _in_parallel(TUNE, _tune),
    )
}


def run_job(act: Callable[[Path, Path], int], inputs: Path, out: Path) -> tuple[int, str]:
    """Its exit code, and the line of an error that a verb would have shown itself."""
    try:
        return act(inputs, out), ""
    except RallyscopeError as error:
        return 2, f"rallyscope: {error}\n"
