"""`rallyscope bench NAME`: measure speed and quality on this machine."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import inspect
import json
from collections.abc import Callable
from dataclasses import dataclass

from app.cli.arguments import flag, positional
from app.cli.progress import progress_bar
from app.cli.quiet_viser import silence_viser
from app.cli.tables import format_table
from core.errors import CommandError, NotBuiltError

BENCHES = {
    "import": "core.bench.recordings.bench_import",
    "detection": "core.bench.detection.bench_detection",
    "simulation": "core.bench.simulation.bench_simulation",
    "sensor": "core.bench.simulation.bench_sensor",
    "calibration": "core.bench.calibration.bench_calibration",
    "physics": "core.bench.physics.bench_physics",
    "prediction": "core.bench.prediction.bench_prediction",
    "perceived-prediction": "core.bench.prediction.bench_perceived_prediction",
    "rally": "core.bench.rally.bench_rally",
    "scenes": "core.bench.rally.bench_scenes",
    "learning": "core.bench.learning.bench_learning",
    "labels": "labels.bench_labels",
    "label-mode": "app.bench.bench_label_mode",
    "export": "app.bench.bench_export",
    "app": "app.bench.bench_app",
}
"""The module that measures each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchArguments:
    """Measure speed and quality on this machine."""

    name: str = positional("what to measure", "|".join(BENCHES), choices=BENCHES)
    count: int | None = flag("balls of each speed (perceived-prediction only)", "N")
    json: bool = flag("print the figures as JSON")


def run(arguments: BenchArguments) -> None:
    """Run the module of the name and print what it returns: "rows", "machine" and what else it has."""
    module = find_bench(arguments.name)
    if module is None:
        built = ", ".join(name for name in BENCHES if find_bench(name))
        raise NotBuiltError(f"`rallyscope bench {arguments.name}` is not built yet", remedy=f"there is {built}")
    measure: Callable[..., dict[str, object]] = importlib.import_module(module).run
    if arguments.count is not None:
        if "count" not in inspect.signature(measure).parameters or arguments.count < 1:
            raise CommandError("no such count", expected="from 1, of a bench that has one", where="--count")
        measure = functools.partial(measure, count=arguments.count)
    silence_viser()
    with progress_bar(f"Measuring {arguments.name}") as progress:
        report = measure(progress)
    if arguments.json:
        print(json.dumps(report))
        return
    rows = report.pop("rows")
    assert isinstance(rows, list)
    print(format_table(rows))
    for name, value in report.items():
        print(f"{name}: {value if isinstance(value, str) else json.dumps(value)}")


def find_bench(name: str) -> str | None:
    """The module that measures this, or None while there is none."""
    module = BENCHES[name]
    return module if importlib.util.find_spec(module) else None
