"""Results of a finished run per speed over all its seeds, for the last or best policy, with trivial policies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from core.errors import ConfigError
from core.learning.config import EnvironmentConfig
from core.learning.evaluation.policy_evaluator import PolicyEvaluator, PolicyScore, score_played, score_trivial_policies
from core.learning.runs.run_files import load_policy, read_run, seeds_of
from core.learning.task.environment import EpisodeBackend, evaluation_balls

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SeedSpread:
    """Mean over seeds, their standard deviation, and the 95 % interval of the mean (Student's t)."""

    mean: float
    std: float
    low: float
    high: float
    count: int


def spread_of(values: Sequence[float]) -> SeedSpread:
    """Spread of one value per seed; values that are not known are left out."""
    known = np.array([value for value in values if math.isfinite(value)])
    if len(known) == 0:
        return SeedSpread(math.nan, math.nan, math.nan, math.nan, 0)
    mean = float(known.mean())
    if len(known) == 1:
        return SeedSpread(mean, math.nan, math.nan, math.nan, 1)
    std = float(known.std(ddof=1))
    from scipy.special import stdtrit  # Student's t; loaded late, because the app's page waits for this module

    half = float(stdtrit(len(known) - 1, 0.975)) * std / math.sqrt(len(known))
    return SeedSpread(mean, std, mean - half, mean + half, len(known))


def evaluate_run(
    run: Path,
    *,
    speeds_mps: Sequence[float] | None = None,
    balls: int | None = None,
    which: Literal["last", "best"] = "last",
    environment: EnvironmentConfig | None = None,
    baselines: bool = True,
    backend: EpisodeBackend | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[dict[str, object]]:
    """A row per speed: the contract of `rallyscope evaluate --json`.

    By default at the speeds, with the balls and in the environment that the run was trained for. On a `backend` every
    policy plays every ball there to its end. The trivial policies are always played in closed form: the search of the
    best stroke takes hundreds of strokes a ball.

    Raises:
        ConfigError: if there is no trained policy.
    """
    config = read_run(run)
    seeds = seeds_of(run)
    if not seeds:
        raise ConfigError("a run without a policy", where=run, remedy="train it first")
    policies = [load_policy(run, seed, which) for seed in seeds]
    environment = environment or config.environment
    speeds = speeds_mps or sorted(set(config.curriculum.speeds_mps))
    # Baselines know the truth, so their balls need no perception.
    known = environment if backend is None else dataclasses.replace(environment, state_source="truth", outcomes="told")
    evaluator = PolicyEvaluator(known, balls or config.evaluation_balls)
    quick = dataclasses.replace(known, engine="closed-form")
    trivial = evaluator if quick == known else PolicyEvaluator(quick, balls or config.evaluation_balls)
    done, steps = 0, len(speeds) * len(policies)
    rows = []
    for speed in speeds:
        scores = []
        for policy in policies:

            def show(share: float, done: int = done) -> None:
                progress((done + share) / steps)

            if backend is None:
                scores.append(evaluator.score(policy, speed))
            else:
                drawn = evaluation_balls(speed, balls or config.evaluation_balls, environment)
                scores.append(score_played(backend, policy, drawn, show))
            done += 1
        row = summarise_scores(scores)
        row["episodes"] = config.episodes
        row["recorded"] = bool(environment.recorded)
        if baselines:
            row["baselines"] = baseline_row(trivial, speed, quick)
        rows.append(row)
    return rows


def summarise_scores(scores: Sequence[PolicyScore]) -> dict[str, object]:
    """One score per seed at one speed -> balls of all seeds together, and the spread over seeds."""
    errors = np.concatenate([score.counted_mm for score in scores])
    returned = np.concatenate([score.returned for score in scores])
    return {
        "speed_mps": scores[0].speed_mps,
        "balls": len(scores[0].returned),
        "seeds": len(scores),
        "returned": float(returned.mean()),
        "missed": float(np.mean([score.missed for score in scores])),
        "error_mm": _distribution(errors),
        "error_returned_mm": _distribution(errors[returned]),
        "seeds_returned": _spread_row(spread_of([score.return_rate for score in scores])),
        "seeds_error_mm": _spread_row(spread_of([score.error_mm for score in scores])),
    }


def baseline_row(evaluator: PolicyEvaluator, speed_mps: float, environment: EnvironmentConfig) -> dict[str, object]:
    """What the trivial policies and the oracle score at a speed."""
    found = score_trivial_policies(evaluator, speed_mps, environment)
    row: dict[str, object] = {
        name: {"returned": score.return_rate, "error_mm": finite_or_none(score.error_mm)}
        for name, score in (("zero", found.zero), ("random", found.random), ("oracle", found.oracle))
    }
    return row | {"constant_centre": {"error_mm": finite_or_none(found.constant_mm)}}


def finite_or_none(value: float) -> float | None:
    """The number itself, None if it is not finite: JSON has neither nan nor infinity."""
    return float(value) if math.isfinite(value) else None


def _distribution(errors_mm: Array) -> dict[str, float | None]:
    known = errors_mm[np.isfinite(errors_mm)]
    if len(known) == 0:
        return {"mean": None, "std": None, "median": None, "p95": None}
    return {
        "mean": float(known.mean()),
        "std": float(known.std()),
        "median": float(np.median(known)),
        "p95": float(np.percentile(known, 95)),
    }


def _spread_row(spread: SeedSpread) -> dict[str, object]:
    return {
        "mean": finite_or_none(spread.mean),
        "std": finite_or_none(spread.std),
        "interval95": [finite_or_none(spread.low), finite_or_none(spread.high)],
    }
