"""The table of robustness, as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from benchmarks.machine import machine_words
from benchmarks.robustness.cells import CELLS
from core.text.markdown_table import markdown_table, two_digits

Row = Mapping[str, object]

ABOUT: Final = """Rallies through two simulated 1280x720 event cameras of the `side` placement, detector `refined`,
serves of 3 to 9 m/s without spin, drawn evenly, the built-in controller aimed at (0.8, 0) m, the racket of the profile
`real` (the controller knows its rubber in every row). Sessions of {session} balls: in each, drag, restitution and
friction of the lab are drawn about what is published ({constants}), and chain and controller are told nothing of that:
they begin with what is published and learn from ball to ball. Rows that are told something exactly have it under
*told*. A row with a constant off has the other two as published. Signs, directions, cameras and instants are drawn for
each session, the racket's tilt and the blocked 20 ms for each ball; serves are the same in all rows. Late commands: the
racket hears of a command so much later, and takes so much longer. *Led*: a step test of {steps} steps before the
session says by how much, and the controller sends the racket so much earlier;
where that differs from command to command the last decision stands longer. Flicker: events of a disc of 81 pixels,
two bursts of 1 ms in 10 ms, laid over each picture. Landing: from where a returned ball lands to the goal.
Intervals are Wilson's, 95 %."""
TITLES: Final = ("wrong", "told", "balls", "returned % (95 %)", "net/out/own half/missed", "landing mm, median (p95)")
FILTER: Final = """Recorded flights (tt3d, 179 Hz, 1 to 2 mm of noise), thinned to 140 points/s, with noise added to
3 mm: every second flight by name, of those that spin up to 450 rad/s ({flights}). The filter that is told nothing was
tuned on the others; `told real` has constants that were fitted to 49 of all 70. From 100 ms of a flight on, at every
second point, before and after the bounce. NEES: mean squared error over the variance that was said, per coordinate (1
is honest); beside it without the flights that touched the net by their recorded height there ({off_net} are left)."""
FILTER_TITLES: Final = ("filter", "ms ahead", "median mm", "nine tenths within mm", "NEES", "NEES off the net")


def write_robustness_report(
    rows: Sequence[Row],
    filters: Sequence[Row],
    machine: Mapping[str, object],
    *,
    seed: int,
    session: int,
    steps: int,
    constants: str,
) -> str:
    """The page as Markdown; without rows of filters it says nothing of recorded flights."""
    balls = max((int(str(row["balls"])) for row in rows), default=0)
    parts = [
        "# What it costs to know the constants only roughly",
        f"Made by `rallyscope bench robustness --balls {balls} --folder FOLDER --report"
        f" docs/measured/robustness-report.md` (seed {seed}; {machine_words(machine)}).",
        ABOUT.format(session=session, steps=steps, constants=constants),
        markdown_table(TITLES, [_cells(row) for row in _ordered(rows)]).rstrip(),
    ]
    steps_off = [f"{row['words']}: {_signed(row['latency_error_ms'])} ms" for row in rows if row["latency_error_ms"]]
    if steps_off:
        parts.append(f"Largest error of a step test: {'; '.join(steps_off)}.")
    if filters:
        flights, off_net = filters[0]["flights"], filters[0]["off_net"]
        parts += [
            "## The filter on recorded flights",
            FILTER.format(flights=flights, off_net=off_net),
            markdown_table(FILTER_TITLES, [_filter_cells(row) for row in filters]).rstrip(),
        ]
    return "\n\n".join(parts) + "\n"


def _ordered(rows: Sequence[Row]) -> list[Row]:
    places = {cell.name: number for number, cell in enumerate(CELLS)}
    return sorted(rows, key=lambda row: places[str(row["row"])])


def _cells(row: Row) -> list[str]:
    share, low, high = (100 * float(str(row[name])) for name in ("returned", "returned_low", "returned_high"))
    landing = "-"
    if row["landing_mm_median"] is not None:
        landing = f"{two_digits(row['landing_mm_median'])} ({two_digits(row['landing_mm_p95'])})"
    return [
        str(row["words"]),
        str(row["told"]) or "-",
        str(row["balls"]),
        f"{share:.0f} ({low:.0f}-{high:.0f})",
        "/".join(str(row[case]) for case in ("net", "out", "own_half", "missed")),
        landing,
    ]


def _filter_cells(row: Row) -> list[str]:
    return [
        str(row["filter"]),
        str(row["ahead_ms"]),
        two_digits(row["median_mm"]),
        f"{float(str(row['worst_tenth_mm'])):.0f}",
        f"{float(str(row['nees'])):.2f}",
        f"{float(str(row['nees_off_net'])):.2f}",
    ]


def _signed(value: object) -> str:
    return f"{float(str(value)):+.1f}"
