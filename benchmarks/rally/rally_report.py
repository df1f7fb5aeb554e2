"""The balls that came back, by chain and speed, as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from benchmarks.machine import machine_words
from core.metrics.intervals import binomial_interval
from core.text.markdown_table import markdown_table, two_digits

CHAINS: Final = {
    "filter": "the live rally's: detector `refined`, every point counts",
    "fit": "the same detector, gravity through twelve points 4 ms apart, friction at the table",
    "paper": "the paper's detector; five points 10 ms apart, one factor at the table, five new ones after the bounce",
    "auto": "the live rally's filter, with what the detector `auto` sees",
    "known": "no cameras: told at the launch exactly what will arrive",
}
ABOUT: Final = """Two 1280x720 cameras of the `side` placement, noise 0.1 events/s/pixel, physics `{physics}`, serves
without spin, built-in controller aimed at (0.8, 0) m, racket in the picture, windows of 2 ms. Chain and
controller are `told` the physics exactly. The world waits for the
chain, so the load of the machine changes no outcome; the delay is a block of 10 ms. Landing: from where a returned ball
lands to the goal. Intervals are Wilson's. A step is wall time of chain and controller beside whatever else ran."""
TITLES: Final = (
    "serve m/s", "balls", "returned % (95 %)", "net/out/own half/missed", "landing mm, median (p95)",
    "3D error mm, median (p95)", "step ms p50 / p99",
)  # fmt: skip


def write_rally_report(
    rows: Sequence[Mapping[str, object]], machine: Mapping[str, object], seed: int, physics: str
) -> str:
    """The page as Markdown."""
    parts = [
        "# Balls returned through perception",
        f"Made by `rallyscope bench rally --report docs/measured/rally-report.md` (seed {seed};"
        f" {machine_words(machine)}).",
        ABOUT.format(physics=physics),
    ]
    for chain, words in CHAINS.items():
        mine = [row for row in rows if row["chain"] == chain]
        if mine:
            table = markdown_table(TITLES, [_cells(row) for row in mine]).rstrip()
            parts += [f"## `{chain}`", f"{words[0].upper()}{words[1:]}.", table]
    return "\n\n".join(parts) + "\n"


def _cells(row: Mapping[str, object]) -> list[str]:
    share, balls = float(str(row["returned"])), int(str(row["balls"]))
    low, high = binomial_interval(share, balls)
    return [
        f"{row['speed_mps']:g}",
        str(balls),
        f"{100 * share:.0f} ({100 * low:.0f}-{100 * high:.0f})",
        "/".join(str(row[case]) for case in ("net", "out", "own_half", "missed")),
        _pair(row, "landing_mm"),
        _pair(row, "point_mm"),
        "-" if row["step_ms_p50"] is None else f"{row['step_ms_p50']:.2f} / {row['step_ms_p99']:.2f}",
    ]


def _pair(row: Mapping[str, object], name: str) -> str:
    median, high = row[f"{name}_median"], row[f"{name}_p95"]
    return "-" if median is None else f"{two_digits(median)} ({two_digits(high)})"
