"""`rallyscope bench NAME`: measure speed and quality on this machine."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from app.cli.arguments import DATA, Numbers, PositiveFloat, PositiveInt, flag, given, positional
from app.cli.backend_arguments import BackendArguments
from app.cli.progress import Progress, progress_bar
from app.cli.quiet_viser import silence_viser
from app.cli.tables import format_row, format_table
from app.cli.terminal import say
from core.errors import CommandError

BENCHES = {
    "import": "benchmarks.recordings.bench_import",
    "record": "benchmarks.recordings.bench_record",
    "detection": "benchmarks.detection.bench_detection",
    "drawn-scenes": "benchmarks.detection.bench_drawn_scenes",
    "rivals": "benchmarks.detection.bench_rivals",
    "simulation": "benchmarks.simulation.bench_simulation",
    "sensor": "benchmarks.simulation.bench_sensor",
    "calibration": "benchmarks.calibration.bench_calibration",
    "drift": "benchmarks.calibration.bench_drift",
    "physics": "benchmarks.physics.bench_physics",
    "prediction": "benchmarks.prediction.bench_prediction",
    "perceived-prediction": "benchmarks.prediction.bench_perceived_prediction",
    "rally": "benchmarks.rally.bench_rally",
    "outcomes": "benchmarks.rally.bench_outcomes",
    "ignorance": "benchmarks.ignorance.bench_ignorance",
    "paper-perception": "benchmarks.perception.bench_paper_perception",
    "scenes": "benchmarks.rally.bench_scenes",
    "learning": "benchmarks.learning.bench_learning",
    "paper-settings": "benchmarks.learning.paper_settings.bench_paper_settings",
    "state-errors": "benchmarks.learning.bench_state_errors",
    "jobs": "benchmarks.jobs.bench_jobs",
    "labels": "benchmarks.labels.bench_labels",
    "label-mode": "benchmarks.app.bench_label_mode",
    "export": "benchmarks.app.bench_export",
    "app": "benchmarks.app.bench_app",
    "long": "benchmarks.app.bench_long",
    "damage": "benchmarks.app.bench_damage",
    "faults": "benchmarks.app.bench_faults",
}
"""The module that measures each."""
OWN_RECORDINGS = {"paper-perception": "benchmarks.app.own_balls.bench_own_balls"}
"""The module that measures instead, with `--recorded`: against labels, what is otherwise held against the truth."""


OPTIONS = (
    "count", "folder", "report", "chain", "balls", "speeds", "physics", "only", "recorded", "data", "annotator", "soak",
)  # fmt: skip
"""That only some of them have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchArguments:
    """Measure speed and quality on this machine."""

    name: str = positional("what to measure", "|".join(BENCHES), choices=BENCHES)
    count: PositiveInt | None = flag(
        "balls of each speed (perceived-prediction, state-errors), balls of points alone (outcomes), "
        "flights (drawn-scenes, rivals), "
        "seeds (paper-perception, drift), seeds of both sides of every claim (learning, paper-settings), "
        "damages of each kind of file (damage), trials of each fault and job (faults), events (long), pieces (jobs), "
        "seconds (record)",
        "N",
    )
    folder: Path | None = flag(
        "what is measured is kept here "
        "(learning, paper-settings, state-errors, perceived-prediction, drawn-scenes, paper-perception, outcomes, "
        "ignorance)"
    )
    report: Path | None = flag("the page, for a bench that writes one", "FILE.md")
    chain: Literal["filter", "fit", "paper", "auto", "known"] | None = flag(
        "which chain plays (rally)", "filter|fit|paper|auto|known", "the first three"
    )
    balls: PositiveInt | None = flag(
        "of each chain and speed (rally), through cameras (outcomes), of each row (ignorance)", "N", "20, 40, 100"
    )
    speeds: Numbers | None = flag("of the serves (rally)", "MPS,MPS...", "3 to 9")
    physics: Literal["paper", "real"] | None = flag("of the balls (rally, outcomes)", "paper|real", "paper; both")
    soak: PositiveFloat | None = flag("under load for so long (app)", "MINUTES")
    only: str | None = flag(
        "a fault, or a job (faults); a kind of file (damage); door, return, page or pace (app); a row (ignorance); "
        "real-balls or slow-serves (learning); a method (paper-perception with --recorded)",
        "NAME",
        "all",
    )
    recorded: str | None = flag(
        "balls of human play, a file of ball states or a folder of them (learning); "
        "your own recordings, one or a folder, scored against their labels (paper-perception)",
        "PATH",
    )
    data: Path | None = flag("workspace with the labels (paper-perception with --recorded)", "DIR", str(DATA))
    annotator: str | None = flag("whose labels (paper-perception with --recorded)", "NAME", "everybody's, apart")
    engine: BackendArguments
    json: bool = flag("print the figures as JSON")


def run(arguments: BenchArguments) -> None:
    """Run the module of the name and print what it returns: "rows", "machine" and what else it has."""
    module = find_bench(arguments.name)
    if arguments.recorded is not None:
        module = OWN_RECORDINGS.get(arguments.name, module)
    if module is None:
        built = ", ".join(name for name in BENCHES if find_bench(name))
        raise CommandError(f"`rallyscope bench {arguments.name}` is not built yet", remedy=f"there is {built}")
    measure: Callable[..., dict[str, object]] = importlib.import_module(module).run
    options: dict[str, object] = given({name: getattr(arguments, name) for name in OPTIONS})
    taken = inspect.signature(measure).parameters.keys()
    asked = given({"jobs": arguments.engine.jobs, "cluster": arguments.engine.cluster})
    for name in [*(options.keys() - taken), *([] if "engine" in taken else asked)]:
        raise CommandError(f"`bench {arguments.name}` has no such option", got=f"--{name}")
    if asked:
        options["engine"] = arguments.engine.engine()
    silence_viser()
    with progress_bar(f"Measuring {arguments.name}") as progress:
        report = measure(_RowsAsTheyCome(progress), **options)
    if arguments.json:
        say(json.dumps(report))
        return
    rows = report.pop("rows")
    assert isinstance(rows, list)
    say(format_table(rows))
    for name, value in report.items():
        say(f"{name}: {value if isinstance(value, str) else json.dumps(value)}")


class _RowsAsTheyCome:
    """Progress that says each row as soon as it is measured."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def __call__(self, share: float) -> None:
        self._progress(share)

    def row(self, row: Mapping[str, object]) -> None:
        """Say it in one line."""
        self._progress.say(format_row(row))


def find_bench(name: str) -> str | None:
    """The module that measures this, or None while there is none."""
    module = BENCHES[name]
    return module if importlib.util.find_spec(module) else None
