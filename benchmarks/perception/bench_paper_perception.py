"""The paper's comparisons of perception, one command: every method on the seven recordings of `paper7`, seed by seed.

What is missing is made first (one set takes 415 seconds of one core's time). Every result is kept: an interrupted bench
goes on where it was. After a change of a method's code, remove the folder `results`; changed settings are noticed. One
recording is measured at a time, so that nothing else is in the caches, unless more are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from benchmarks.machine import describe_machine
from benchmarks.perception.comparisons import FIGURES, SeedRun, compare, estimate
from benchmarks.perception.measure import METHOD as FRAME_METHOD
from benchmarks.perception.measure import load_recording, measure_frames, measure_method, read_recording, weights_stamp
from benchmarks.perception.page import draw_windows, html_page, markdown_page, report_sections
from benchmarks.perception.results import (
    FIRST_SEED,
    METHODS,
    ROWS,
    PerceptionResult,
    RecordingReading,
    frame_result_path,
    keep,
    kept_reading,
    kept_result,
    reading_path,
    result_path,
    seed_plan,
    set_folder,
)
from core.data_sets import DataSetPlan, PlannedRecording, run_data_set
from core.files import replace_file
from core.jobs import ALONE, HERE, JobBackend, TaskControl, open_jobs
from core.recordings import open_recording

FOLDER: Final = Path("rallyscope-data/bench-paper-perception")
REPORT: Final = Path("docs/measured/perception-report.md")
COUNT: Final = 1
"""Seeds; ten make the full report."""
MAKING_SHARE: Final = 0.7
"""Of the time of a seed whose recordings are still to be made."""

Progress = Callable[[float], None]
PICTURE: Final = "perception-window.png"
"""One of the page's pictures by itself: of the middle recording."""


def run(
    progress: Progress, *, folder: Path = FOLDER, report: Path = REPORT, count: int = COUNT, engine: JobBackend = HERE
) -> dict[str, object]:
    """A row per method and the intervals of its figures, the comparisons, the report's two pages, and the machine."""
    runs: list[SeedRun] = []
    for number in range(count):
        seed = FIRST_SEED + number

        def seed_progress(share: float, number: int = number) -> None:
            progress((number + share) / count)

        planned = seed_plan(seed)
        runs.append(run_seed(planned, folder, seed_progress, with_recordings=number == 0, engine=engine))
    pictures = draw_windows(runs[0], set_folder(folder, runs[0].seed))
    machine = describe_machine("numba", "opencv-python-headless", clock="processor time of one thread, warm")
    sections = report_sections(runs, machine)
    page = report.with_suffix(".html")
    replace_file(report, markdown_page(sections, page.name).encode(), durable=False)
    replace_file(page, html_page(sections, pictures).encode(), durable=False)
    replace_file(report.parent / "images" / PICTURE, pictures[len(pictures) // 2].png, durable=False)
    return {
        "rows": [_row(runs, method) for method in ROWS],
        "intervals": {method: _intervals(runs, method) for method in ROWS},
        "comparisons": [asdict(one) for one in compare(runs)],
        "seeds": [one.seed for one in runs],
        "report": str(report),
        "page": str(page),
        "machine": machine,
    }


def run_seed(
    planned: DataSetPlan, folder: Path, progress: Progress, *, with_recordings: bool, engine: JobBackend = HERE
) -> SeedRun:
    """Every method on every recording of a seed, measured now or kept; recordings are made if they are still needed.

    Raises:
        JobsError: if a cluster cannot be used, or the workers of a recording keep dying.
    """
    missing = [one for one in planned.recordings if not _is_measured(folder, planned.seed, one)]
    base = 0.0
    if missing or with_recordings:
        base = 0.0 if _are_there(planned, folder) else MAKING_SHARE
        there = set_folder(folder, planned.seed)
        run_data_set(planned, there, engine=engine, progress=lambda share: progress(base * share))
    if missing:  # a folder in which everything is kept is only read
        with open_jobs(ALONE if engine == HERE else engine, len(missing)) as jobs:
            work = MeasureTask(jobs.share_folder(folder), planned.seed)
            jobs.run(work, missing, name=_name, progress=lambda share: progress(base + (1 - base) * share))
    progress(1.0)
    results: list[PerceptionResult] = []
    readings: list[RecordingReading] = []
    for one in planned.recordings:
        reading = kept_reading(reading_path(folder, planned.seed, one.name))
        found = [kept_result(path) for path in _result_paths(folder, planned.seed, one.name)]
        assert reading is not None
        readings.append(reading)
        results += [result for result in found if result is not None]
    return SeedRun(planned.seed, tuple(results), tuple(readings))


@dataclass(frozen=True, slots=True)
class MeasureTask:
    """Measures a recording of a seed in the folder that all who work see."""

    folder: Path
    seed: int

    def __call__(self, planned: PlannedRecording, control: TaskControl) -> None:
        """What is not kept yet."""
        measure_recording(planned, self.folder, self.seed)


def _name(planned: PlannedRecording) -> str:
    return planned.name


def measure_recording(planned: PlannedRecording, folder: Path, seed: int) -> None:
    """Measure and keep what is not kept yet."""
    with open_recording(set_folder(folder, seed) / f"{planned.name}.h5") as file:
        recording = load_recording(file, scene=planned.scene, seed=seed, name=planned.name)
        for method in METHODS:
            path = result_path(folder, seed, planned.name, method)
            if kept_result(path) is None:
                keep(path, measure_method(recording, method))
        path = _frame_path(folder, seed, planned.name)
        if path is not None and kept_result(path) is None and (result := measure_frames(recording)) is not None:
            keep(path, result)
        path = reading_path(folder, seed, planned.name)
        if kept_reading(path) is None:
            keep(path, read_recording(recording))


def _is_measured(folder: Path, seed: int, planned: PlannedRecording) -> bool:
    if kept_reading(reading_path(folder, seed, planned.name)) is None:
        return False
    paths = _result_paths(folder, seed, planned.name)
    if planned.making.frames is None:  # then the frame detector has nothing to say
        paths = paths[: len(METHODS)]
    return all(kept_result(path) is not None for path in paths)


def _result_paths(folder: Path, seed: int, recording: str) -> list[Path]:
    """Result paths of every method; the frame detector's is last, if it has weights."""
    paths = [result_path(folder, seed, recording, method) for method in METHODS]
    frames = _frame_path(folder, seed, recording)
    return paths if frames is None else [*paths, frames]


def _frame_path(folder: Path, seed: int, recording: str) -> Path | None:
    """None without weights: the rows are empty then, and the report says why."""
    stamp = weights_stamp()
    return None if stamp is None else frame_result_path(folder, seed, recording, FRAME_METHOD, stamp)


def _are_there(planned: DataSetPlan, folder: Path) -> bool:
    there = set_folder(folder, planned.seed)
    return all((there / f"{one.name}.h5").is_file() for one in planned.recordings)


def _row(runs: Sequence[SeedRun], method: str) -> dict[str, object]:
    figures = {name: _finite(estimate(runs, method, figure).value) for name, figure in FIGURES.items()}
    return {"method": method, **figures}


def _intervals(runs: Sequence[SeedRun], method: str) -> dict[str, tuple[float | None, float | None]]:
    found = {name: estimate(runs, method, figure) for name, figure in FIGURES.items()}
    return {name: (_finite(one.low), _finite(one.high)) for name, one in found.items()}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
