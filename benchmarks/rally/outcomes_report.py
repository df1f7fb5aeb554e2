"""Outcomes judged by perception, as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from benchmarks.machine import machine_words
from core.text.markdown_table import markdown_table, two_digits

ABOUT: Final = """What came of a stroke, judged from the chain's points alone (`core.outcomes`), beside what the
simulation tells. Serves of 3 to 9 m/s, drawn evenly. `cameras`: simulated events of two 1280x720 cameras of the `side`
placement, detector `refined`, calibration exact; strokes with actions from the whole range (half of them) and from its
middle, 8 % of them called off 50 ms before the ball. `cameras, idle racket`: the same, and the racket stays at rest.
`points`: no cameras; the same physics in closed form, and points with the noise that was measured of the first row's
chain, nothing for 10 ms after the racket, 5 % without a stroke. Neither chain nor judge is told air or table: the
points decide between flights with air and without. Landing: where the ball comes down to the table's plane, from where
the simulation says, over balls that both say were struck. NEES: mean squared error over the covariance, per coordinate
(1 is honest, less is too careful). The serve's speed is that at which it was first seen, from that at its launch.
Intervals are Wilson's, 95 %."""
TITLES: Final = (
    "seen through", "physics", "balls", "agree % (95 %)", "sure (p >= .9), of these wrong", "landing mm, median (p95)",
    "NEES", "net mm, median", "hit ms, p95", "serve m/s, median (p95)",
)  # fmt: skip


def write_outcomes_report(rows: Sequence[Mapping[str, object]], machine: Mapping[str, object], seed: int) -> str:
    """The page as Markdown."""
    parts = [
        "# Outcomes that the cameras see",
        f"Made by `rallyscope bench outcomes --balls {rows[0]['balls']} --count {rows[-1]['balls']} --report"
        f" docs/measured/outcomes-report.md` (seed {seed}; {machine_words(machine)}).",
        ABOUT,
        markdown_table(TITLES, [_cells(row) for row in rows]).rstrip(),
        "Agreed of told, by case:",
        "\n".join(f"- {row['seen_through']}, {row['physics']}: {row['cases']}." for row in rows),
    ]
    return "\n\n".join(parts) + "\n"


def _cells(row: Mapping[str, object]) -> list[str]:
    low, high = (100 * float(str(row[name])) for name in ("agree_low", "agree_high"))
    return [
        str(row["seen_through"]),
        str(row["physics"]),
        str(row["balls"]),
        f"{100 * float(str(row['agree'])):.1f} ({low:.1f}-{high:.1f})",
        f"{row['sure']}, {row['sure_and_wrong']}",
        f"{two_digits(row['landing_mm_median'])} ({two_digits(row['landing_mm_p95'])})",
        two_digits(row["landing_nees"]),
        two_digits(row["net_mm_median"]),
        two_digits(row["hit_ms_p95"]),
        f"{two_digits(row['serve_mps_median'])} ({two_digits(row['serve_mps_p95'])})",
    ]
