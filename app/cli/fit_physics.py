"""`rallyscope fit-physics`: drag, restitution and friction from recorded flights."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.cli.arguments import flag, positional
from app.cli.files import check_folder, write_text
from app.cli.progress import progress_bar
from app.cli.terminal import format_table, print_lines, say
from core.errors import CommandError
from core.text import counted

if TYPE_CHECKING:
    from core.metrics.flight_predictions import FlightErrors

TEST_SHARE = 0.3
MOST_SAMPLES = 10_000


@dataclass(frozen=True, slots=True, kw_only=True)
class FitPhysicsArguments:
    """Fit the flight model to real flights: drag, restitution and friction."""

    flights: tuple[Path, ...] = positional("CSV of t_s,x_m,y_m,z_m (world), or as tt3d writes it", "FLIGHTS")
    magnus: float = flag("Magnus coefficient, which flights do not fix", "CM", 0.10)
    samples: int = flag("bootstrap samples for the spread", "N", 20)
    seed: int = flag("random seed of the split into fit and test", "N", 0)
    out: Path | None = flag("write the constants as JSON, for `--constants` of other verbs", "FILE")
    json: bool = flag("print the figures as JSON")


def run(arguments: FitPhysicsArguments) -> None:
    """Fit on most of the flights, test on the others, print both."""
    if not 0 <= arguments.magnus <= 0.5:
        raise CommandError("no such coefficient", expected="0 to 0.5", got=arguments.magnus, where="--magnus")
    if not 2 <= arguments.samples <= MOST_SAMPLES:
        expected = f"2 to {MOST_SAMPLES}"
        raise CommandError("not a usable count", expected=expected, got=arguments.samples, where="--samples")
    if arguments.seed < 0:
        raise CommandError("not a usable seed", expected="0 or more", got=arguments.seed, where="--seed")
    if len(arguments.flights) < 4:
        raise CommandError(
            "not enough flights", expected="4 or more: some are kept for the test", got=len(arguments.flights)
        )
    if arguments.out is not None:
        check_folder(arguments.out)
    from core.metrics.flight_predictions import compare_models, compare_predictors
    from core.physics.fit_flights import bootstrap, fit_physics, read_flight_file

    read = [read_flight_file(path) for path in arguments.flights]
    flights = [flight for flight, _ in read]
    # Drawn, not the last ones: flights that were recorded in a row are alike.
    order = np.random.default_rng(arguments.seed).permutation(len(flights))
    tests = max(1, round(TEST_SHARE * len(flights)))
    test, fit = ([flights[k] for k in part] for part in (order[:tests], order[tests:]))
    with progress_bar("Fitting") as progress:
        fitted = fit_physics(fit, arguments.magnus)
        progress(0.2)
        spread = bootstrap(fit, fitted, arguments.samples, arguments.seed, lambda share: progress(0.2 + 0.7 * share))
        errors = compare_models(test, fitted, lambda share: progress(0.9 + 0.1 * share))
        predictors = compare_predictors(test, fitted)
    constants = {
        "drag_coefficient": {"value": fitted.drag_coefficient, "sigma": spread.drag_coefficient},
        "restitution": {"value": fitted.restitution, "sigma": spread.restitution},
        "friction": {"value": fitted.friction, "sigma": spread.friction},
    }
    spins = np.linalg.norm(fitted.starts[:, 6:], axis=1)
    report = {
        **constants,
        "magnus_coefficient": fitted.magnus_coefficient,
        "residual_m": {"rms": fitted.rms_m, "median": fitted.median_m},
        "spins_radps": {flight.name: float(spin) for flight, spin in zip(fit, spins, strict=True)},
        "test": [{"model": name, **asdict(row)} for name, row in errors.items()],
        "predictors": [{"method": name, **asdict(row)} for name, row in predictors.items()],
        "flights": {"fit": len(fit), "test": len(test)},
        "taken_for": {flight.name: [points.taken_for, *points.notes] for flight, points in read},
    }
    if arguments.out is not None:
        write_text(arguments.out, json.dumps(report, indent=1) + "\n")
    if arguments.json:
        say(json.dumps(report))
        return
    print_lines(f"{flight.name}: {'; '.join([points.taken_for, *points.notes])}" for flight, points in read)
    flights = f"{counted(len(fit), 'flight')} fitted, {len(test)} kept for the test"
    say(f"{flights}; median distance {1e3 * fitted.median_m:.1f} mm")
    say(format_table([{"constant": name, **values} for name, values in constants.items()]))
    say()
    say("Test flights, errors after 150 ms of observation, mm (median, 95 %):")
    say(format_table([_row("model", name, row) for name, row in errors.items()]))
    say()
    say(
        "Test flights, predicted point by point from the same 150 ms, mm (median, 95 %; squared error over its spread):"
    )
    rows = [_row("predictor", name, row) | _by_time(row.normalised, " nees") for name, row in predictors.items()]
    say(format_table(rows))


def _row(kind: str, name: str, errors: FlightErrors) -> dict[str, object]:
    bounce = {"bounce": errors.bounce_median_mm, "bounce 95 %": errors.bounce_p95_mm}
    return {kind: name} | bounce | _by_time(errors.ahead_median_mm) | _by_time(errors.ahead_p95_mm, " 95 %")


def _by_time(values: dict[float, float], words: str = "") -> dict[str, object]:
    return {f"{1e3 * ahead:.0f} ms{words}": value for ahead, value in values.items()}
