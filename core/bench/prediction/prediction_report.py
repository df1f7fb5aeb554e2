"""The figures of prediction as a page: through the cameras, from truth with noise, and on recorded flights."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.bench.line_chart import ChartLine, line_chart
from core.bench.machine import machine_words
from core.errors import RecordingError

Row = Mapping[str, object]

PICTURE: Final = "prediction-lead.svg"
TOP_MM: Final = 100.0
"""Of the chart."""
NAMES: Final = {"filter": "filter", "fit": "chain's fit", "paper": "paper's rule"}


@dataclass(frozen=True, slots=True)
class PerceivedFigures:
    """What was measured through the cameras."""

    rows: list[dict[str, object]]
    """By speed and method, and over all speeds ("all")."""
    leads: list[dict[str, object]]
    """By method and lead time."""


HEADER = """# How well the ball is predicted

Made by `rallyscope bench perceived-prediction` (seed {seed}; {machine}).

The filter is that of [trajectory](trajectory.md); the *paper's rule* is five points 10 ms apart, gravity, and one
factor each for the two speeds at the table (medians of recorded bounces: .94 and .83); the *chain's fit* takes twelve
points 4 ms apart and spinless Coulomb friction. Errors at the hitting plane x = -1.42 m are those along it; the time's
error is beside it. Every figure is median / 95 % unless it says otherwise. A prediction counts from the moment at which
the chain had made it.

Simulated balls: profile `real` (drag, Magnus force, the table that was [fitted](physics-report.md) to recorded
flights), serves of 3 to 9 m/s in equal numbers, spin uniform within 100 rad/s about each axis. The filter knows these
constants with standard deviations of .02, the table's height to 1 or 2 mm, and of the spin that it is some 200 rad/s.
"""

CAMERAS = """
## Through the cameras
{balls} balls, two cameras of the `side` placement (1280x720), noise 0.1 events/s/pixel, perfect calibration, windows of
2 ms, detector `auto`; the points are {point} mm from the ball.

{table}

Normalised error squared at the plane (y, z and time over their covariance; 1 is honest), by lead time:

{normalised}

![prediction error by lead time]({picture})

{leads}
"""

EXACT = """
## Truth plus 1 mm at 1 kHz
`rallyscope bench prediction`, {flights} balls, no cameras, seed 7.

{table}

{leads}

Normalised error squared of the filter's position and velocity: {before} 80 ms before the landing, {after} 30 ms after
the bounce (1 is honest). An update takes {update} ms, one with its prediction {p50} ms (99 %: {p99} ms).
"""

FLIGHTS = """
## Recorded flights
`rallyscope fit-physics tt3d/*.csv --samples 10 --json > rallyscope-data/bench-prediction/flights.json`: the constants
are fitted on {fit} of the 70 flights between two players, the others ({test}) are predicted after 150 ms. Millimetres
from the recorded point; `gravity`, `drag` and `drag + Magnus` are least-squares fits of the whole 150 ms.

{table}

Mean squared error over its variance (three axes; 1 is honest), without the worst flight, which touches the net just
after it was seen: {spread}.
"""


def write_prediction_report(
    path: Path, perceived: PerceivedFigures, exact: Row, flights: Path, seed: int, machine: Mapping[str, object]
) -> None:
    """Write the page and its chart; the recorded flights are in it if `flights`, which `fit-physics` made, is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    about = machine_words(machine)
    pictures = path.parent / "images"
    pictures.mkdir(exist_ok=True)
    (pictures / PICTURE).write_text(lead_chart(perceived.leads), encoding="utf-8")
    parts = [HEADER.format(seed=seed, machine=about), _cameras(perceived), _exact(exact)]
    if flights.exists():
        parts.append(_flights(flights))
    path.write_text("".join(parts), encoding="utf-8")


def lead_chart(leads: Sequence[Row]) -> str:
    """The median error at the plane by lead time, with a band up to 95 %."""
    lines = []
    for method, name in NAMES.items():
        rows = [row for row in leads if row["method"] == method and row["error_flights"]]
        median = [float(str(row["error_median_mm"])) for row in rows]
        high = [float(str(row["error_p95_mm"])) for row in rows]
        lines.append(ChartLine(name, [float(str(row["lead_ms"])) for row in rows], median, median, high))
    title = "Prediction of the hitting point from two event cameras: median, band to 95 %"
    return line_chart(title, "ms before the ball is there", "mm along the plane", lines, y_top=TOP_MM)


def _cameras(perceived: PerceivedFigures) -> str:
    everything = next(row for row in perceived.rows if row["speed_mps"] == "all")
    lines = [
        [
            str(row["speed_mps"]),
            NAMES[str(row["method"])],
            str(row["balls"]),
            _pair(row, "landing_80ms_ahead"),
            _pair(row, "hit_plane_30ms_after"),
            f"{_text(row['hit_time_median_ms'])} / {_text(row['hit_time_p95_ms'])}",
        ]
        for row in perceived.rows
    ]
    titles = [
        "serve m/s",
        "method",
        "balls",
        "landing 80 ms ahead, mm",
        "plane 30 ms after the bounce, mm",
        "time then, ms",
    ]
    shares = [
        f"{row['lead_ms']} ms {_text(row['normalised'])}"
        for row in perceived.leads
        if row["method"] == "filter" and row["error_flights"]
    ]
    return CAMERAS.format(
        balls=everything["balls"],
        point=f"{_text(everything['point_median_mm'])} / {_text(everything['point_p95_mm'])}",
        table=_table(titles, lines),
        normalised=", ".join(shares) + ".",
        picture=f"images/{PICTURE}",
        leads=_leads(perceived.leads, tuple(NAMES)),
    )


def _exact(exact: Row) -> str:
    rows, leads = exact["rows"], exact["leads"]
    assert isinstance(rows, list) and isinstance(leads, list)
    titles = ["method", "landing 80 ms ahead, mm", "plane 30 ms after the bounce, mm", "time then, ms"]
    lines = [
        [
            NAMES[row["method"]],
            _pair(row, "landing_80ms_ahead"),
            _pair(row, "hit_plane_30ms_after"),
            f"{_text(row['hit_time_median_ms'])} / {_text(row['hit_time_p95_ms'])}",
        ]
        for row in rows
    ]
    flown = rows[0]
    return EXACT.format(
        flights=exact["flights"],
        table=_table(titles, lines),
        leads=_leads(leads, ("filter", "paper")),
        before=flown["nees"]["before landing"],
        after=flown["nees"]["after bounce"],
        update=flown["update_ms"],
        p50=flown["update_with_prediction_p50_ms"],
        p99=flown["update_with_prediction_p99_ms"],
    )


def _flights(path: Path) -> str:
    """What `fit-physics --json` found.

    Raises:
        RecordingError: if the file is something else.
    """
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
        predictors, test = report["predictors"], report["test"]
        lines = [
            [
                NAMES.get(row.get("method"), row.get("model")),
                f"{row['bounce_median_mm']:.0f} / {row['bounce_p95_mm']:.0f}",
                *(f"{row['ahead_median_mm'][a]:.0f} / {row['ahead_p95_mm'][a]:.0f}" for a in row["ahead_median_mm"]),
            ]
            for row in [*predictors, *test]
        ]
        counts = [f"{1e3 * float(a):.0f} ms ahead ({n})" for a, n in predictors[0]["flights"].items()]
        spread = "; ".join(
            f"{NAMES[row['method']]} "
            + ", ".join(f"{value:.2f} at {1e3 * float(a):.0f} ms" for a, value in row["normalised_but_worst"].items())
            for row in predictors
        )
        fit, held = report["flights"]["fit"], report["flights"]["test"]
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        remedy = "make it with `rallyscope fit-physics FLIGHTS... --json`"
        raise RecordingError("not a report of fit-physics", got=repr(error), where=path, remedy=remedy) from error
    return FLIGHTS.format(fit=fit, test=held, table=_table(["", "bounce", *counts], lines), spread=spread)


def _leads(leads: Sequence[Row], methods: Sequence[str]) -> str:
    titles = ["ms before", *(f"{NAMES[method]}, mm (time, ms)" for method in methods)]
    times = sorted({int(str(row["lead_ms"])) for row in leads})
    lines = []
    for lead in times:
        cells = [str(lead)]
        for method in methods:
            row = next(row for row in leads if row["method"] == method and row["lead_ms"] == lead)
            cells.append(f"{_pair(row, 'error')} ({_text(row['time_median_ms'])})")
        lines.append(cells)
    return _table(titles, lines)


def _pair(row: Row, name: str) -> str:
    return f"{_text(row[f'{name}_median_mm'])} / {_text(row[f'{name}_p95_mm'])}"


def _text(value: object) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) and value < 10 else (
        f"{value:.0f}" if isinstance(value, float) else "-" if value is None else str(value)
    )  # fmt: skip


def _table(titles: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    rows = [titles, ["---"] * len(titles), *lines]
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in rows)
