"""How long the list of balls takes to be selected and drawn: 10,000 balls of many recordings."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from app.modes.watch.ball_list import ROWS, BallQuery, balls_html, moment_link, select_balls
from app.shared.ball_index import BallIndex
from benchmarks.machine import describe_machine, report_rows_to
from labels.balls.rows import BallRow
from labels.balls.table import joined, table_of

BALLS: Final = 10_000
BALLS_OF_RECORDING: Final = 100
REPEATS: Final = 50
SEED: Final = 49
CONDITIONS: Final = (
    "",
    "kind=bounce",
    "speed_mps=5..5.01",
    "kind=stroke outcome=net|out speed_mps=5..7 spin_radps=50..",
    "name=recording-7|recording-8 labels=1..",
    "t_us=1000000.. error_m=..0.1 net_z_m=0.2..0.3 number=10..90 method=truth source=recording",
)


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """A row per set of conditions: rows found, and p50 and largest of the time to select and to write a page, ms."""
    index = _index()
    rows: list[dict[str, object]] = []
    for number, conditions in enumerate(CONDITIONS):
        took_ms, found = [], 0
        for _ in range(REPEATS):
            began_s = time.perf_counter()
            selected = select_balls(BallQuery(index, conditions))
            page = index.table.take(selected[:ROWS]).to_pylist()
            balls_html(page, [moment_link(str(row["name"]), "Watch", int(row["t_us"])) for row in page])
            took_ms.append(1e3 * (time.perf_counter() - began_s))
            found = len(selected)
        times = {"p50_ms": float(np.median(took_ms)), "max_ms": max(took_ms)}
        rows.append({"conditions": conditions or "none", "found": found, **times})
        report_rows_to(progress, rows[-1:], (number + 1) / len(CONDITIONS))
    return {"rows": rows, "balls": BALLS, "events": len(index.table), "repeats": REPEATS,
            "machine": describe_machine("pyarrow"), "seed": SEED}  # fmt: skip


def _index() -> BallIndex:
    """Two flights, a bounce and a stroke of each ball, with random figures."""
    rng = np.random.default_rng(SEED)
    parts = []
    for recording in range(BALLS // BALLS_OF_RECORDING):
        rows = [
            BallRow(
                kind=kind,
                number=number,
                t_us=int(rng.integers(10**8)),
                speed_mps=float(rng.uniform(3, 9)),
                spin_radps=float(rng.uniform(0, 150)),
                spin_sigma_radps=0.0,
                net_z_m=float(rng.uniform(0, 0.6)),
                error_m=float(rng.uniform(0, 0.5)),
                outcome=str(rng.choice(["net", "out", "returned", "missed"])),
                method="truth",
            )
            for number in range(1, BALLS_OF_RECORDING + 1)
            for kind in ("flight", "bounce", "flight", "stroke")
        ]
        parts.append(("recording", f"recording-{recording}", table_of(rows), rng.integers(0, 3, len(rows))))
    return BallIndex(joined(parts), (), np.zeros(1, np.int64))
