"""What predictions of flights were off by, and how far they said so: at the landing, at the plane, by lead time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.trajectory import HitPlane, Prediction

Array = NDArray[np.float64]

BEFORE_LANDING_S: Final = 0.080
AFTER_BOUNCE_S: Final = 0.030
LEADS_MS: Final = (25, 50, 75, 100, 150, 200, 250, 300, 400)


@dataclass(frozen=True, slots=True, eq=False)
class FlightTruth:
    """Where a ball bounced and crossed the hitting plane."""

    bounce_s: float
    landing_m: Array
    """(3,) its centre then."""
    hit_s: float
    hit_m: Array
    """(3,)."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictionSeries:
    """Predictions of one flight, in order of the times at which they were made."""

    when_s: list[float]
    predictions: list[Prediction]

    def at(self, t_s: float) -> Prediction | None:
        """The newest one that there was at a time."""
        found = bisect_right(self.when_s, t_s) - 1
        return self.predictions[found] if found >= 0 else None


@dataclass(slots=True)
class PredictionErrors:
    """Errors of one method, an entry per flight. At the hitting plane those along it; the time's is separate."""

    landing_mm: list[float] = field(default_factory=list)
    plane_mm: list[float] = field(default_factory=list)
    time_ms: list[float] = field(default_factory=list)
    by_lead_mm: dict[int, list[float]] = field(default_factory=lambda: {lead: [] for lead in LEADS_MS})
    by_lead_ms: dict[int, list[float]] = field(default_factory=lambda: {lead: [] for lead in LEADS_MS})
    normalised: dict[int, list[float]] = field(default_factory=lambda: {lead: [] for lead in LEADS_MS})
    """By lead time: squared error of y, z and time in units of their covariance, over three."""
    nees: dict[str, list[float]] = field(default_factory=lambda: {"before landing": [], "after bounce": []})
    """Of the estimated position and velocity."""
    seconds: list[float] = field(default_factory=list)
    """Of an update that made a prediction."""
    quiet_seconds: list[float] = field(default_factory=list)
    """Of one that did not."""

    def score(self, series: PredictionSeries, truth: FlightTruth) -> None:
        """Compare what was said of a flight with what came of it."""
        before = series.at(truth.bounce_s - BEFORE_LANDING_S)
        if before is not None and before.landing is not None:
            self.landing_mm.append(1e3 * float(np.linalg.norm(before.landing.p_world_m - truth.landing_m)))
        after = series.at(truth.bounce_s + AFTER_BOUNCE_S)
        if truth.bounce_s + AFTER_BOUNCE_S < truth.hit_s and after is not None and after.hit_plane is not None:
            self.plane_mm.append(plane_error_mm(after.hit_plane, truth))
            self.time_ms.append(1e3 * abs(after.hit_plane.t_s - truth.hit_s))
        for lead in LEADS_MS:
            newest = series.at(truth.hit_s - 1e-3 * lead)
            if newest is not None and newest.hit_plane is not None:
                self.by_lead_mm[lead].append(plane_error_mm(newest.hit_plane, truth))
                self.by_lead_ms[lead].append(1e3 * abs(newest.hit_plane.t_s - truth.hit_s))
                self.normalised[lead].append(_normalised(newest.hit_plane, truth))

    def row(self) -> dict[str, object]:
        """The figures by name."""
        row = median_and_p95(self.landing_mm, "landing_80ms_ahead")
        row |= median_and_p95(self.plane_mm, "hit_plane_30ms_after")
        row["hit_time_median_ms"] = rounded(self.time_ms, 50)
        row["hit_time_p95_ms"] = rounded(self.time_ms, 95)
        if self.seconds:
            milliseconds = 1e3 * np.array(self.seconds)
            row["update_ms"] = rounded(1e3 * np.array(self.quiet_seconds), 50, 4)
            row["update_with_prediction_p50_ms"] = rounded(milliseconds, 50, 4)
            row["update_with_prediction_p99_ms"] = rounded(milliseconds, 99, 4)
        row["nees"] = {when: round(float(np.mean(values)), 3) for when, values in self.nees.items() if values}
        return row

    def leads(self) -> list[dict[str, object]]:
        """The errors at the plane by lead time."""
        return [
            {
                "lead_ms": lead,
                **median_and_p95(self.by_lead_mm[lead], "error"),
                "time_median_ms": rounded(self.by_lead_ms[lead], 50),
                "normalised": round(float(np.mean(self.normalised[lead])), 2) if self.normalised[lead] else None,
            }
            for lead in LEADS_MS
        ]


def plane_error_mm(hit: HitPlane, truth: FlightTruth) -> float:
    """How far off along the plane."""
    off = hit.p_world_m - truth.hit_m
    return 1e3 * float(np.hypot(off[1], off[2]))


def _normalised(hit: HitPlane, truth: FlightTruth) -> float:
    off = (hit.p_world_m - truth.hit_m)[1:]
    # Time and place are correlated, but only their standard deviations are said.
    across = float(off @ np.linalg.solve(hit.covariance[1:3, 1:3] + 1e-14 * np.eye(2), off))
    return (across + ((hit.t_s - truth.hit_s) / max(hit.sigma_t_s, 1e-9)) ** 2) / 3


def rounded(values: Sequence[float] | Array, percent: float, digits: int = 2) -> float | None:
    """A percentile; None of nothing."""
    return round(float(np.percentile(values, percent)), digits) if len(values) else None


def median_and_p95(values: Sequence[float], name: str) -> dict[str, object]:
    """Both in millimetres, and of how many flights."""
    return {
        f"{name}_median_mm": rounded(values, 50),
        f"{name}_p95_mm": rounded(values, 95),
        f"{name}_flights": len(values),
    }
