"""`rallyscope bench NAME`: measure speed and quality on this machine."""

from __future__ import annotations

import importlib
import inspect
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Final, Literal

from app.cli.arguments import DATA, Counts, Numbers, PositiveFloat, PositiveInt, flag, given, positional
from app.cli.backend_arguments import BackendArguments
from app.cli.progress import Progress, progress_bar
from app.cli.terminal import format_row, format_table, say, silence_viser
from core.errors import CommandError

BENCHES = {
    "import": "recordings.bench_import",
    "detection": "detection.bench_detection",
    "drawn-scenes": "detection.bench_drawn_scenes",
    "planet": "detection.bench_planet",
    "rivals": "detection.bench_rivals",
    "single-views": "detection.bench_single_views",
    "slow-receptors": "detection.bench_slow_receptors",
    "simulation": "simulation.bench_simulation",
    "cameras": "perception.bench_cameras",
    "rig": "calibration.bench_rig",
    "prediction": "prediction.bench_prediction",
    "rally": "rally.bench_rally",
    "first-balls": "rally.bench_first_balls",
    "outcomes": "rally.bench_outcomes",
    "robustness": "robustness.bench_robustness",
    "paper-perception": "perception.bench_paper_perception",
    "learning": "learning.bench_learning",
    "labels": "labels.bench_labels",
    "export": "app.bench_export",
    "balls": "app.bench_balls",
    "app": "app.bench_app",
}
"""The module of the folder benchmarks/ that measures each."""
OWN_RECORDINGS = {"paper-perception": "app.own_balls.bench_own_balls"}
"""The module that measures instead with `--recorded`: against labels, not against simulated truth."""
CHECKOUT: Final = Path(__file__).parents[2]
"""Where benchmarks/ lies when the package is used from a checkout."""


OPTIONS = (
    "count", "seeds", "trials", "folder", "report", "chain", "balls", "speeds", "physics", "only", "recorded", "data",
    "annotator", "soak", "rig", "cameras", "hit", "seed", "unknown", "elevation_spread", "latency",
)  # fmt: skip
"""That only some of them have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchArguments:
    """Measure speed and quality on this machine."""

    name: str = positional("what to measure", "|".join(BENCHES), choices=BENCHES)
    count: PositiveInt | None = flag(
        "balls of points alone (outcomes), flights (drawn-scenes, slow-receptors; of each kind: rivals), "
        "seeds (paper-perception, rig), "
        "seeds of everything that is compared (learning), serves of each scene and speed (cameras)",
        "N",
    )
    seeds: Counts | None = flag("of the serves (single-views)", "N,N...", "511,512")
    trials: PositiveInt | None = flag("of tuning, for each method (rivals)", "N", "24")
    folder: Path | None = flag(
        "what is measured is kept here (learning, drawn-scenes, rivals, paper-perception, outcomes, robustness)"
    )
    report: Path | None = flag("the page, for a bench that writes one", "FILE.md")
    chain: Literal["filter", "fit", "paper", "auto", "points", "known"] | None = flag(
        "which chain plays (rally)", "filter|fit|paper|auto|points|known", "the first three"
    )
    balls: PositiveInt | None = flag(
        "of each chain and speed (rally), of each speed (first-balls), through cameras (outcomes), "
        "of each row (robustness)",
        "N",
        "20, 20, 40, 100",
    )
    speeds: Numbers | None = flag("of the serves (rally, first-balls)", "MPS,MPS...", "3 to 9; 6 to 9")
    physics: Literal["paper", "real"] | None = flag(
        "of the balls (rally, first-balls, outcomes)", "paper|real", "paper; both"
    )
    hit: Literal["chosen", "paper"] | None = flag("where balls are met (rally)", "chosen|paper", "paper")
    unknown: bool = flag("chain and controller learn air and table instead of being told (rally)")
    elevation_spread: PositiveFloat | None = flag(
        "serves up to so much flatter and steeper than the standard ones, 10 at most (rally, first-balls)",
        "DEG",
        "0; 8",
    )
    seed: int | None = flag(
        "of the serves (rally), the first one (first-balls; of a part: cameras with --only)",
        "N",
        "2026, 462200; each part's own",
    )
    latency: bool = flag("and where the time of live commands goes, without and with a browser (rally)")
    soak: PositiveFloat | None = flag("under load for so long (app)", "MINUTES")
    only: str | None = flag(
        "return, page, pace, cameras, rest or space (app); scenes, wrong, alone, faults or pace (cameras); "
        "a row (robustness); claims or real-balls (learning); "
        "a method (paper-perception with --recorded)",
        "NAME",
        "all",
    )
    recorded: str | None = flag(
        "balls of human play, a file of ball states or a folder of them (learning); "
        "your own recordings, one or a folder, scored against their labels (paper-perception); "
        "gen4.dat of faery (planet)",
        "PATH",
    )
    data: Path | None = flag("workspace with the labels (paper-perception with --recorded)", "DIR", str(DATA))
    annotator: str | None = flag("whose labels (paper-perception with --recorded)", "NAME", "everybody's, apart")
    cameras: PositiveInt | None = flag("so many cameras in Watch and Label (app)", "N", "4 with --only cameras")
    rig: Path | None = flag("calibration file of three cameras or more (cameras)", "FILE", "four at the corners")
    engine: BackendArguments
    json: bool = flag("print the figures as JSON")


def run(arguments: BenchArguments) -> None:
    """Run the module of the name and print what it returns: "rows", "machine" and what else it has."""
    measure, options = requested_bench(arguments)
    silence_viser()
    with progress_bar(f"Measuring {arguments.name}") as progress:
        report = measure(_RowPrinter(progress), **options)
    if arguments.json:
        say(json.dumps(report))
        return
    rows = report.pop("rows")
    assert isinstance(rows, list)
    say(format_table(rows))
    for name, value in report.items():
        say(f"{name}: {value if isinstance(value, str) else json.dumps(value)}")


def requested_bench(arguments: BenchArguments) -> tuple[Callable[..., dict[str, object]], dict[str, object]]:
    """What measures, and the options that are given to it.

    Raises:
        CommandError: where there are no benchmarks, or this one has no such option.
    """
    name = BENCHES[arguments.name]
    if arguments.recorded is not None:
        name = OWN_RECORDINGS.get(arguments.name, name)
    module = load_from_checkout(name)
    values = {name: getattr(arguments, name) for name in OPTIONS}
    options: dict[str, object] = given({name: None if value is False else value for name, value in values.items()})
    taken = inspect.signature(module.run).parameters.keys()
    asked = given({"jobs": arguments.engine.jobs, "cluster": arguments.engine.cluster})
    for option in [*(options.keys() - taken), *([] if "engine" in taken else asked)]:
        raise CommandError(f"`bench {arguments.name}` has no such option", got=f"--{option}")
    if asked:
        options["engine"] = arguments.engine.engine()
    return module.run, options


class _RowPrinter:
    """Progress that prints each row as soon as it is measured."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def __call__(self, share: float) -> None:
        self._progress(share)

    def row(self, row: Mapping[str, object]) -> None:
        """Say it in one line."""
        self._progress.say(format_row(row))


def load_from_checkout(module: str) -> ModuleType:
    """A module of the folder benchmarks/ beside the packages; it is part of a checkout, not of an installation.

    Raises:
        CommandError: where there is no such folder.
    """
    if not (CHECKOUT / "benchmarks" / "__init__.py").is_file():
        raise CommandError(
            "benchmarks, and the training of detectors, are not installed with the package",
            expected=f"the folder benchmarks/ of a checkout of the source in {CHECKOUT}",
            remedy="clone the repository, `pip install -e '.[bench]'` there, and run the command from it",
        )
    if str(CHECKOUT) not in sys.path:  # an editable installation finds the packages alone
        sys.path.append(str(CHECKOUT))
    return importlib.import_module(f"benchmarks.{module}")
