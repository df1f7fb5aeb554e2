"""Balls whose outcome was judged by perception and told by the simulation: one record each, and rows of figures."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.metrics.intervals import binomial_interval
from core.outcomes import ClassifiedStroke, ServeSeen
from core.physics.episode import Case

Array = NDArray[np.float64]
UNSURE: Final = 0.9
"""A judgement of a lower probability says itself that it may be wrong."""


@dataclass(frozen=True, slots=True)
class ComparedBall:
    """One ball; lengths in metres, NaN (null in a file) where there is nothing to compare."""

    speed_mps: float
    told: int
    judged: int
    probability: float
    landing_error_m: float
    landing_squared: float
    """Squared error of the landing over its covariance, per coordinate: 1 on average if the covariance is honest."""
    net_error_m: float
    net_squared: float
    hit_error_s: float
    serve_error_mps: float
    serve_late_s: float
    points: int
    late_s: float
    """From the first contact, as told, to the judgement."""


def compare_ball(
    judged: ClassifiedStroke | None,
    serve: ServeSeen | None,
    *,
    told: Case,
    landing_m: Array,
    net_z_m: float,
    hit_s: float,
    decided_s: float,
    speed_mps: float,
    launch_mps: float,
    launch_s: float,
) -> ComparedBall:
    """The judgement beside what was told; no judgement counts as a wrong one. Times in seconds of the same clock."""
    nan = math.nan
    both = judged is not None and judged.case is not Case.MISSED and told is not Case.MISSED
    off = judged.landing_m[:2] - landing_m[:2] if both and judged is not None else np.full(2, nan)
    squared = nan
    if judged is not None and np.isfinite(off).all():
        squared = float(off @ np.linalg.solve(judged.landing_covariance_m2, off)) / 2
    net = judged.net_z_m - net_z_m if both and judged is not None else nan
    return ComparedBall(
        speed_mps=speed_mps,
        told=int(told),
        judged=0 if judged is None else int(judged.case),
        probability=0.0 if judged is None else judged.probability,
        landing_error_m=float(np.linalg.norm(off)),
        landing_squared=squared,
        net_error_m=net,
        net_squared=nan if judged is None else (net / judged.net_sigma_m) ** 2,
        hit_error_s=nan if judged is None or not both else judged.hit_us * 1e-6 - hit_s,
        serve_error_mps=nan if serve is None else serve.speed_mps - launch_mps,
        serve_late_s=nan if serve is None else serve.t_us * 1e-6 - launch_s,
        points=0 if judged is None else judged.points,
        late_s=nan if judged is None else judged.t_us * 1e-6 - decided_s,
    )


def outcome_row(name: str, physics: str, balls: Sequence[ComparedBall]) -> dict[str, object]:
    """The figures of many balls."""
    agree = np.array([one.told == one.judged for one in balls])
    share = float(agree.mean())
    low, high = binomial_interval(share, len(balls))
    unsure = np.array([one.probability < UNSURE for one in balls])
    return {
        "seen_through": name,
        "physics": physics,
        "balls": len(balls),
        "agree": share,
        "agree_low": low,
        "agree_high": high,
        "sure": int((~unsure).sum()),
        "sure_and_wrong": int((~unsure & ~agree).sum()),
        "landing_mm_median": _millimetres(balls, "landing_error_m", 50),
        "landing_mm_p95": _millimetres(balls, "landing_error_m", 95),
        "landing_nees": _mean([one.landing_squared for one in balls]),
        "landing_nees_median": _percentile([one.landing_squared for one in balls], 50),
        "net_mm_median": _millimetres(balls, "net_error_m", 50),
        "net_nees": _mean([one.net_squared for one in balls]),
        "hit_ms_p95": _scaled(_percentile([abs(one.hit_error_s) for one in balls], 95)),
        "serve_mps_median": _percentile([abs(one.serve_error_mps) for one in balls], 50),
        "serve_mps_p95": _percentile([abs(one.serve_error_mps) for one in balls], 95),
        "serve_late_ms_median": _scaled(_percentile([one.serve_late_s for one in balls], 50)),
        "judged_after_ms_median": _scaled(_percentile([one.late_s for one in balls], 50)),
        "cases": _cases(balls),
    }


def read_ball(values: Mapping[str, object]) -> ComparedBall:
    """A record as it was written."""
    plain = {name: math.nan if value is None else value for name, value in values.items()}
    return ComparedBall(**plain)  # type: ignore[arg-type]


def _cases(balls: Sequence[ComparedBall]) -> str:
    """Agreed of told, by case."""
    told = Counter(one.told for one in balls)
    right = Counter(one.told for one in balls if one.told == one.judged)
    return ", ".join(f"{case.name.lower()} {right[case]}/{told[case]}" for case in Case if told[case])


def _mean(values: Sequence[float]) -> float | None:
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else None


def _percentile(values: Sequence[float], share: float) -> float | None:
    known = [value for value in values if math.isfinite(value)]
    return float(np.percentile(known, share)) if known else None


def _scaled(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def _millimetres(balls: Sequence[ComparedBall], name: str, share: float) -> float | None:
    return _scaled(_percentile([abs(getattr(one, name)) for one in balls], share))
