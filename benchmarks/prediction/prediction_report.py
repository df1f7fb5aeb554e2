"""The figures of prediction as a page: through the cameras, from truth with noise, and on recorded flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.charts import ChartLine, line_chart
from benchmarks.machine import machine_words
from core.errors import RecordingError
from core.text.json_text import parse_json
from core.text.markdown_table import markdown_table

Row = Mapping[str, object]

PICTURE: Final = "prediction-lead.svg"
TOP_MM: Final = 100.0
"""Of the chart."""
NAMES: Final = {
    "filter": "filter",
    "fit": "chain's fit",
    "paper": "paper's rule",
    "filter-auto": "filter, detector `auto`",
}


@dataclass(frozen=True, slots=True)
class PerceivedFigures:
    """What was measured through the cameras."""

    rows: list[dict[str, object]]
    """By speed and method, and over all speeds ("all")."""
    leads: list[dict[str, object]]
    """By method and lead time."""


HEADER = """# How well the ball is predicted

Made by `rallyscope bench perceived-prediction` (seed {seed}; {machine}).

The filter is that of [trajectory](../how/trajectory.md); the *paper's rule* is five points 10 ms apart, gravity, and
one factor each for the two speeds at the table (medians of recorded bounces: .94 and .83); the *chain's fit* takes
twelve points 4 ms apart and spinless Coulomb friction. Errors at the hitting plane x = -1.42 m are those along it; the
time's error is beside it. Every figure is median / 95 % unless it says otherwise. A prediction counts from the moment
at which the chain had made it.

Simulated balls: profile `real` (drag, Magnus force, the table that was [fitted](physics-report.md) to recorded
flights), serves of 3 to 9 m/s in equal numbers, spin uniform within 100 rad/s about each axis. Through the cameras no
two balls have the same drag, restitution and friction: they are drawn about the fitted ones with standard deviations of
.02, which is what the filter knows of them; it knows the table's height to 1 or 2 mm, and how much serves spin.
"""

CAMERAS = """
## Through the cameras
{balls} balls, two cameras of the `side` placement (1280x720), noise 0.1 events/s/pixel, perfect calibration, windows of
2 ms, detector `refined` but for the last method; the points are {point} mm from the ball ({auto} mm with `auto`).

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
    parts = [HEADER.format(seed=seed, machine=about), _cameras(perceived), _exact(exact)]
    if flights.exists():
        parts.append(_flights(flights))
    path.write_text("".join(parts), encoding="utf-8")
    draw_leads(path.parent / "images" / PICTURE, perceived.leads)


def draw_leads(path: Path, leads: Sequence[Row]) -> None:
    """Draw the median error at the plane by lead time, with a band up to 95 %."""
    lines = []
    for method, name in NAMES.items():
        rows = [row for row in leads if row["method"] == method and row["error_flights"]]
        lead, median, high = (
            [float(str(row[k])) for row in rows] for k in ("lead_ms", "error_median_mm", "error_p95_mm")
        )
        lines.append(ChartLine(name, lead, median, median, high))
    title = "Prediction of the hitting point from two event cameras: median, band to 95 %"
    line_chart(path, title, "ms before the ball is there", "mm along the plane", lines, y_top=TOP_MM)


def _cameras(perceived: PerceivedFigures) -> str:
    everything, auto = (
        next(row for row in perceived.rows if row["speed_mps"] == "all" and row["method"] == method)
        for method in ("filter", "filter-auto")
    )
    shares = [
        f"{row['lead_ms']} ms {_text(row['normalised'])}"
        for row in perceived.leads
        if row["method"] == "filter" and row["error_flights"]
    ]
    return CAMERAS.format(
        balls=everything["balls"],
        point=f"{_text(everything['point_median_mm'])} / {_text(everything['point_p95_mm'])}",
        auto=f"{_text(auto['point_median_mm'])} / {_text(auto['point_p95_mm'])}",
        table=_errors(perceived.rows, {"speed_mps": "serve m/s", "method": "method", "balls": "balls"}),
        normalised=", ".join(shares) + ".",
        picture=f"images/{PICTURE}",
        leads=_leads(perceived.leads, tuple(NAMES)),
    )


def _exact(exact: Row) -> str:
    rows, leads = exact["rows"], exact["leads"]
    assert isinstance(rows, list) and isinstance(leads, list)
    flown = rows[0]
    return EXACT.format(
        flights=exact["flights"],
        table=_errors(rows, {"method": "method"}),
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
        report = parse_json(path.read_text(encoding="utf-8"))
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
    return FLIGHTS.format(
        fit=fit, test=held, table=markdown_table(["", "bounce", *counts], lines).rstrip(), spread=spread
    )


def _errors(rows: Sequence[Row], names: Mapping[str, str]) -> str:
    """Under the titles of what names a row, and its errors."""
    titles = [*names.values(), "landing 80 ms ahead, mm", "plane 30 ms after the bounce, mm", "time then, ms"]
    lines = [
        [
            *(NAMES.get(str(row[name]), str(row[name])) for name in names),
            _pair(row, "landing_80ms_ahead"),
            _pair(row, "hit_plane_30ms_after"),
            _pair(row, "hit_time", "ms"),
        ]
        for row in rows
    ]
    return markdown_table(titles, lines).rstrip()


def _leads(leads: Sequence[Row], methods: Sequence[str]) -> str:
    titles = ["ms before", *(f"{NAMES[method]}, mm (time, ms)" for method in methods)]
    said: dict[str, dict[object, str]] = {}
    for row in sorted(leads, key=lambda row: int(str(row["lead_ms"]))):
        words = f"{_pair(row, 'error')} ({_text(row['time_median_ms'])})"
        said.setdefault(str(row["lead_ms"]), {})[row["method"]] = words
    lines = [[lead, *(by_method[method] for method in methods)] for lead, by_method in said.items()]
    return markdown_table(titles, lines).rstrip()


def _pair(row: Row, name: str, unit: str = "mm") -> str:
    return f"{_text(row[f'{name}_median_{unit}'])} / {_text(row[f'{name}_p95_{unit}'])}"


def _text(value: object) -> str:
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    return f"{value:.2f}".rstrip("0").rstrip(".") if value < 10 else f"{value:.0f}"
