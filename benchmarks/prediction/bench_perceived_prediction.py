"""How well the flight is predicted from what two event cameras see: the filter, the chain's fit and the paper's rule.

Profile `real` with air and table drawn anew for every ball, serves with spin, the serve speeds in turn, cameras of the
`side` placement, windows of 2 ms. The same balls are seen with the detectors `refined` and `auto`. Balls are seen once
and kept: an interrupted bench goes on where it was, and predictors can be tried again on the same points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.machine import describe_machine
from benchmarks.prediction import bench_prediction
from benchmarks.prediction.perceived_balls import SEED, PerceivedBall, chain_of, perceived_ball
from benchmarks.prediction.prediction_errors import PredictionErrors, rounded
from benchmarks.prediction.prediction_report import PerceivedFigures, write_prediction_report
from core.detection.methods import Method
from core.physics.task import STAGE_SPEEDS_MPS
from core.trajectory import PaperPredictor, Predictor, predictor_for

Progress = Callable[[float], None]
SeenBalls = Mapping[Method, dict[float, list[PerceivedBall]]]
"""By detector and speed, in m/s."""

FOLDER: Final = Path("rallyscope-data/bench-prediction")
REPORT: Final = Path("docs/measured/prediction-report.md")
PER_SPEED: Final = 30
"""210 balls over the seven speeds."""
METHODS: Final[tuple[Method, ...]] = ("refined", "auto")
FEWEST_POINTS: Final = 5
"""A ball counts as seen from so many points on."""


def run(
    progress: Progress, *, folder: Path = FOLDER, report: Path = REPORT, count: int = PER_SPEED
) -> dict[str, object]:
    """A row per method and speed for `count` balls of each speed, the report's place, and the machine."""
    balls: SeenBalls = {method: {speed: [] for speed in STAGE_SPEEDS_MPS} for method in METHODS}
    for number in range(count):  # all speeds in turn: whatever there is, each has its share
        for method, by_speed in balls.items():
            for speed, seen in by_speed.items():
                seen.append(perceived_ball(folder / "balls", speed, number, method))
        progress(0.9 * (number + 1) / count)
    perceived = evaluate(balls)
    exact = bench_prediction.measure_prediction(bench_prediction.PER_SPEED, lambda share: progress(0.9 + 0.1 * share))
    machine = describe_machine("numpy", "numba", clock="processor time of one thread")
    write_prediction_report(report, perceived, exact, folder / "flights.json", SEED, machine)
    return {"rows": perceived.rows, "leads": perceived.leads, "report": str(report), "machine": machine}


def evaluate(balls: SeenBalls) -> PerceivedFigures:
    """What each method says while it is told the points of its detector."""
    rows: list[dict[str, object]] = []
    total: list[dict[str, object]] = []
    leads: list[dict[str, object]] = []
    for detector, by_speed in balls.items():
        whole = {name: PredictionErrors() for name in _predictors(detector)}
        for speed, seen in by_speed.items():
            for name, predictor in _predictors(detector).items():
                errors = PredictionErrors()
                for ball in seen:
                    predictor.reset()
                    said = ball.predict(predictor)
                    errors.score(said, ball.truth)
                    whole[name].score(said, ball.truth)
                rows.append({"speed_mps": speed, "method": name, "balls": len(seen)} | errors.row() | _seen(seen))
        everything = [ball for seen in by_speed.values() for ball in seen]
        for name, errors in whole.items():
            total.append({"speed_mps": "all", "method": name, "balls": len(everything)} | errors.row())
            total[-1] |= _seen(everything)
            leads += [{"method": name} | lead for lead in errors.leads()]
    return PerceivedFigures([*rows, *total], leads)


def _predictors(detector: Method) -> dict[str, Predictor]:
    """By name; the paper's rule has the medians of recorded bounces, which its profile has too."""
    config = chain_of(detector)
    if detector == "auto":
        return {"filter-auto": config.make_predictor()}
    paper = PaperPredictor(predictor_for("real", hit_x_m=config.predictor.hit_x_m))
    fit = replace(config, prediction="fit").make_predictor()
    return {"filter": config.make_predictor(), "fit": fit, "paper": paper}


def _seen(balls: Sequence[PerceivedBall]) -> dict[str, object]:
    errors_mm = 1e3 * np.concatenate([ball.errors_m for ball in balls])
    return {
        "seen": round(float(np.mean([len(ball.t_us) >= FEWEST_POINTS for ball in balls])), 3),
        "point_median_mm": rounded(errors_mm, 50),
        "point_p95_mm": rounded(errors_mm, 95),
    }
