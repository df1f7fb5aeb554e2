"""How surely the alarm of a moved camera rings, and how often it does so for nothing: random turns of one camera.

Rows: a placement and a drift (rms distance of the pictures of the volume above the table from the epipolar lines that
are believed). The rule was chosen with seeds from `TUNED_FROM` on, which are not scored; nor are those below
`SCORED_FROM`, by which an earlier rule was seen to fail. Besides, how well clicked corners of the table alone place a
pair.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from benchmarks.calibration.clicked_rigs import clicked_row
from benchmarks.calibration.drifted_rigs import feed_serves, turn_second
from benchmarks.machine import describe_machine
from benchmarks.partial_rows import report_rows_to
from core.cameras import stereo_preset
from core.cameras.presets import PLACEMENTS
from core.chain.calibration_drift import CalibrationDrift
from core.metrics.intervals import binomial_interval

Row = dict[str, object]
Progress = Callable[[float], None]

DRIFTS_PX: Final = (0.0, 0.3, 0.6, 1.0, 1.5, 20.0)
SEEDS: Final = 100
SERVES: Final = 10
CLICKS_PX: Final = (0.5, 1.0)
"""Errors of clicks along each picture axis."""
SCORED_FROM: Final = 1000
TUNED_FROM: Final = 100_000


def run(progress: Progress, count: int = SEEDS) -> dict[str, object]:
    """Rows of alarms among `count` seeds, of ten serves each; and what as many sets of clicks achieve."""
    rows: list[Row] = []
    for placement in PLACEMENTS:
        for drift_px in DRIFTS_PX:
            rows.append(alarm_row(placement, drift_px, range(SCORED_FROM, SCORED_FROM + count)))
            report_rows_to(progress, rows[-1:], len(rows) / (len(PLACEMENTS) * len(DRIFTS_PX)))
    clicked = [clicked_row(placement, px, range(count)) for placement in PLACEMENTS for px in CLICKS_PX]
    return {
        "rows": rows,
        "clicked": clicked,
        "machine": describe_machine("numpy", seeds=str(count), serves=str(SERVES)),
    }


def alarm_row(placement: str, drift_px: float, seeds: range) -> Row:
    """How often it rang at any time of ten serves, and what was measured in the end."""
    rang, measured, unsure = 0, [], 0
    for seed in seeds:
        alarm, found_px = watch_serves(placement, drift_px, seed)
        rang += alarm
        unsure += found_px is None
        measured.append(np.nan if found_px is None else found_px)
    low, high = binomial_interval(rang / len(seeds), len(seeds))
    known = np.array(measured)[np.isfinite(measured)]
    median, p95 = (round(float(np.percentile(known, q)), 2) if len(known) else None for q in (50, 95))
    return {
        "placement": placement,
        "drift_px": drift_px,
        "alarms": rang,
        "of": len(seeds),
        "share_from": round(low, 3),
        "share_to": round(high, 3),
        "measured_median_px": median,
        "measured_p95_px": p95,
        "never_sure": unsure,
    }


def watch_serves(placement: str, drift_px: float, seed: int) -> tuple[bool, float | None]:
    """Whether it rang at any time, and the drift that was measured last (None: never sure)."""
    rng = np.random.default_rng([seed, round(1000 * drift_px)])
    cameras = stereo_preset(placement)
    monitor = CalibrationDrift(turn_second(cameras, drift_px, rng))
    rang, t_us = False, 0
    for _ in range(SERVES):
        t_us = feed_serves(monitor, cameras, 1, rng, start_us=t_us)
        rang |= monitor.report.alarm
    drift = monitor.report.drift
    return rang, None if drift is None else drift.drift_px
