"""The table of robustness: balls returned, and where they land, by what is wrong with what is believed of a lab.

A row per cell of `cells`; sessions of ten balls are kept in the folder and not played again. With recorded flights in
FOLDER/flights (CSV, as `fit-physics` reads them) the page also has the filter that is told nothing beside told ones.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.machine import describe_machine
from benchmarks.partial_rows import report_rows_to
from benchmarks.robustness.cells import CELLS, Cell
from benchmarks.robustness.play import BALLS, CONSTANTS, SEED, CellSession, PlayedSession, play_session
from benchmarks.robustness.report import write_robustness_report
from core.errors import CommandError
from core.files import replace_file
from core.jobs.backend import ALONE, HERE, JobBackend
from core.jobs.jobs import open_jobs
from core.live.worlds.step_testing import STEPS
from core.metrics.intervals import binomial_interval
from core.metrics.spinning_flights import foresee_flights, spinning_flights, touches_net
from core.physics.episode import Case
from core.physics.fit_flights import RecordedFlight
from core.physics.flight_files import read_flight
from core.text.json_text import parse_json
from core.trajectory import FilterConfig, FilterPredictor, filter_for
from core.trajectory.filter_config import UNKNOWN

FILTERS: Final[dict[str, tuple[FilterConfig, bool]]] = {
    "told `real`": (filter_for("real"), False),
    "told `paper`": (filter_for("paper"), False),
    "told nothing, each flight alone": (replace(filter_for("paper"), perhaps_real=True), False),
    "told nothing, learning from flight to flight": (replace(filter_for("paper"), perhaps_real=True), True),
}
"""With whether they carry over what they learnt."""


def held_out(flights: Sequence[RecordedFlight]) -> list[RecordedFlight]:
    """Every second flight, in the order of their names: the filter was tuned on the others."""
    return spinning_flights(flights[1::2])


def filter_rows(flights: Sequence[RecordedFlight]) -> list[dict[str, object]]:
    """A row per filter and time ahead, over flights that nothing was tuned on."""
    rows = []
    without = [flight for flight in flights if not touches_net(flight)]
    for name, (config, carry) in FILTERS.items():
        found = foresee_flights(FilterPredictor(config), flights, carry=carry)
        clean = foresee_flights(FilterPredictor(config), without, carry=carry)
        rows += [
            {
                "filter": name,
                "ahead_ms": round(1e3 * ahead),
                "flights": len(flights),
                "predictions": len(one.errors_m),
                "median_mm": 1e3 * one.median_m,
                "worst_tenth_mm": 1e3 * one.worst_tenth_m,
                "nees": one.nees,
                "nees_off_net": clean[ahead].nees,
                "off_net": len(without),
            }
            for ahead, one in found.items()
        ]
    return rows


FOLDER: Final = Path("rallyscope-data/bench-robustness")
BALLS_PER_ROW: Final = 100


def run(
    progress: Callable[[float], None],
    *,
    balls: int = BALLS_PER_ROW,
    only: str | None = None,
    folder: Path = FOLDER,
    report: Path | None = None,
    engine: JobBackend = HERE,
) -> dict[str, object]:
    """A row per cell, or the one called `only`, the rows of the filter, and the machine."""
    cells = _chosen(only)
    wanted = [
        CellSession(cell, number, min(BALLS, balls - number * BALLS))
        for number in range(-(-balls // BALLS))
        for cell in cells
    ]
    played = {session: _kept(folder, session) for session in wanted}
    missing = [session for session in wanted if played[session] is None]

    def done(number: int, result: PlayedSession) -> None:
        played[missing[number]] = result
        _keep(folder, missing[number], result)
        report_rows_to(progress, [_row(missing[number].cell, [result])], 1 - (len(missing) - number - 1) / len(wanted))

    with open_jobs(engine if missing else ALONE, max(1, len(missing))) as jobs:
        jobs.run(play_session, missing, name=lambda one: f"{one.cell.name} {one.number}", done=done, progress=progress)
    rows = [
        _row(cell, [found for session, found in played.items() if session.cell == cell and found is not None])
        for cell in cells
    ]
    files = sorted((folder / "flights").glob("*.csv"))
    filters = filter_rows(held_out([read_flight(path) for path in files])) if len(files) > 1 else []
    machine = describe_machine("numba", "numpy", "mujoco", clock="no times are measured")
    if report is not None:
        constants = ", ".join(f"{name} {UNKNOWN[name]:g} +- {UNKNOWN[f'{name}_sigma']:g}" for name in CONSTANTS)
        page = write_robustness_report(
            rows, filters, machine, seed=SEED, session=BALLS, steps=STEPS, constants=constants
        )
        replace_file(report, page.encode(), durable=False)
    return {"rows": rows, "filters": filters, "machine": machine}


def _chosen(only: str | None) -> tuple[Cell, ...]:
    found = tuple(cell for cell in CELLS if only in (None, cell.name))
    if not found:
        expected = ", ".join(cell.name for cell in CELLS)
        raise CommandError("no such row", expected=expected, got=only, where="--only")
    return found


def _row(cell: Cell, sessions: Sequence[PlayedSession]) -> dict[str, object]:
    returned = [one for session in sessions for one in session.returned]
    cases = Counter(case for session in sessions for case in session.cases)
    landing_mm = [1e3 * one for session in sessions for one in session.landing_m if one is not None]
    off_ms = [session.latency_error_ms for session in sessions if session.latency_error_ms is not None]
    share = sum(returned) / len(returned)
    low, high = binomial_interval(share, len(returned))
    return {
        "row": cell.name,
        "words": cell.words,
        "told": cell.told,
        "balls": len(returned),
        "returned": share,
        "returned_low": low,
        "returned_high": high,
        "landing_mm_median": float(np.median(landing_mm)) if landing_mm else None,
        "landing_mm_p95": float(np.percentile(landing_mm, 95)) if landing_mm else None,
        **{case.name.lower(): cases[case.name.lower()] for case in (Case.NET, Case.OUT, Case.OWN_HALF, Case.MISSED)},
        "latency_error_ms": max(off_ms, key=abs) if off_ms else None,
    }


def _path(folder: Path, session: CellSession) -> Path:
    return folder / f"{session.cell.name}-{SEED}-{session.number:03d}-{session.balls}.json"


def _kept(folder: Path, session: CellSession) -> PlayedSession | None:
    path = _path(folder, session)
    if not path.exists():
        return None
    read = parse_json(path.read_text(encoding="utf-8"))
    return PlayedSession(
        tuple(read["returned"]), tuple(read["cases"]), tuple(read["landing_m"]), read["latency_error_ms"]
    )


def _keep(folder: Path, session: CellSession, played: PlayedSession) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    replace_file(_path(folder, session), json.dumps(asdict(played)).encode(), durable=False)
