"""How long the balls take to be selected and drawn, as points and as a page: 10,000 balls of many recordings."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from app.modes.watch.ball_list import BallQuery, scatter_html, view_balls
from app.modes.watch.ball_scatter import ScatterAxes, row_at, rows_within
from app.shared.ball_index import BallIndex, BallSource
from benchmarks.machine import describe_machine, report_rows_to
from labels.balls.rows import BallRow
from labels.balls.table import joined, table_of

BALLS: Final = 10_000
BALLS_OF_RECORDING: Final = 100
REPEATS: Final = 20
SEED: Final = 49
CONDITIONS: Final = (
    "",
    "kind=bounce",
    "speed_mps=5..5.01",
    "kind=stroke outcome=net|out speed_mps=5..7 spin_radps=50..",
    "name=recording-7|recording-8 labels=1..",
    "t_us=1000000.. error_m=..0.1 net_z_m=0.2..0.3 number=10..90 method=truth source=recording",
)


AXES: Final = (ScatterAxes(), ScatterAxes("net_z_m", "name", "speed_mps"))
OUTLINE: Final = ((0.3, 0.3), (0.7, 0.35), (0.6, 0.7))


def run(progress: Callable[[float], None]) -> dict[str, object]:
    """A row per set of conditions and axes: rows found, and p50 and largest of the time to select, draw and write, ms.

    `cpu_p50_ms`: processor time of the same, which other work on the machine does not lengthen. `hand_p50_ms`: to find
    the rows of a click and of a lasso.
    """
    index = _index()
    rows: list[dict[str, object]] = []
    cases = [(conditions, axes) for axes in AXES for conditions in CONDITIONS]
    for number, (conditions, axes) in enumerate(cases):
        took_ms, cpu_ms, hand_ms, found, picture_bytes = [], [], [], 0, 0
        for _ in range(REPEATS):
            began_s, cpu_s = time.perf_counter(), time.process_time()
            view = view_balls(BallQuery(index, conditions, axes))
            picture_bytes = len(scatter_html(view))
            drawn_s = time.perf_counter()
            cpu_ms.append(1e3 * (time.process_time() - cpu_s))
            row_at(view.scatter, 0.5, 0.5)
            rows_within(view.scatter, OUTLINE)
            hand_ms.append(1e3 * (time.perf_counter() - drawn_s))
            took_ms.append(1e3 * (drawn_s - began_s))
            found = len(view.rows)
        drawn = f"{axes.x}, {axes.y}, {axes.colour}"
        rows.append({"conditions": conditions or "none", "drawn": drawn, "found": found, "kb": picture_bytes / 1e3,
                     "p50_ms": float(np.median(took_ms)), "max_ms": max(took_ms),
                     "cpu_p50_ms": float(np.median(cpu_ms)),
                     "hand_p50_ms": float(np.median(hand_ms))})  # fmt: skip
        report_rows_to(progress, rows[-1:], (number + 1) / len(cases))
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
    sources = tuple(BallSource("recording", name, Path(f"{name}.h5")) for _, name, _, _ in parts)
    first_rows = np.cumsum([0, *(len(table) for _, _, table, _ in parts)], dtype=np.int64)
    return BallIndex(joined(parts), sources, first_rows)
