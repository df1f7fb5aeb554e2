"""`rallyscope bench NAME`: measure speed and quality on this machine."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import inspect
import json
from collections.abc import Callable
from pathlib import Path

from app.cli.arguments import positive_int
from app.cli.progress import progress_bar
from app.cli.quiet_viser import silence_viser
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("name", choices=BENCHES, metavar="|".join(BENCHES), help="what to measure")
    parser.add_argument("--count", type=positive_int, metavar="N", help="balls of each speed (perceived-prediction)")
    parser.add_argument("--folder", type=Path, help="what is measured is kept here (learning, perceived-prediction)")
    parser.add_argument("--report", type=Path, metavar="FILE.md", help="the page, for a bench that writes one")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(arguments: argparse.Namespace) -> None:
    """Run the module of the name and print what it returns: "rows", "machine" and what else it has."""
    module = find_bench(arguments.name)
    if module is None:
        built = ", ".join(name for name in BENCHES if find_bench(name))
        raise NotBuiltError(f"`rallyscope bench {arguments.name}` is not built yet", remedy=f"there is {built}")
    measure: Callable[..., dict[str, object]] = importlib.import_module(module).run
    given = {name: vars(arguments).get(name) for name in ("count", "folder", "report")}
    options = {name: value for name, value in given.items() if value is not None}
    for name in options.keys() - inspect.signature(measure).parameters.keys():
        raise CommandError(f"`bench {arguments.name}` has no such option", got=f"--{name}")
    silence_viser()
    with progress_bar(f"Measuring {arguments.name}") as progress:
        report = measure(progress, **options)
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


def format_table(rows: list[dict[str, object]]) -> str:
    """Rows with the same keys as text, numbers to the right and to three decimals."""
    if not rows:
        return "nothing was measured"
    titles = list(rows[0])
    cells = [[_cell(row.get(title)) for title in titles] for row in rows]
    widths = [max(len(line[k]) for line in [titles, *cells]) for k in range(len(titles))]
    lines = [
        "  ".join(text.rjust(width) for text, width in zip(line, widths, strict=True)) for line in [titles, *cells]
    ]
    return "\n".join(lines)


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)
