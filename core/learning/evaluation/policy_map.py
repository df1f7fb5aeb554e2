"""Policy map: mean landing for targets all over the opponent's half, on serves not used in training.

Every target gets the same serves with the same noise, so two cells differ by the target alone.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.learning.agents.policy import ActionSource
from core.learning.config import EnvironmentConfig, GoalConfig
from core.learning.evaluation.policy_evaluator import MISSED_MM, landing_errors_mm
from core.learning.task.environment import draw_serve_batch, play
from core.physics.episode import Case
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

Array = NDArray[np.float64]
MAP_SEED: Final = 20260406
"""Seed of the serves of maps: others than those of training, evaluation and validation."""
ALONG: Final = 7
"""Cells from the net to the opponent's end."""
ACROSS: Final = 8
"""Cells from side to side: with `ALONG` they are nearly square, 19 cm."""
SERVES: Final = 24
"""Serves per target."""


@dataclass(frozen=True, slots=True, eq=False)
class TrainedTargets:
    """The box of targets that a policy was trained on, in the table's plane; a point if it was one target."""

    low_m: tuple[float, float]
    high_m: tuple[float, float]

    @property
    def is_one(self) -> bool:
        """Whether there is one target for all balls."""
        return self.low_m == self.high_m


@dataclass(frozen=True, slots=True, eq=False)
class PolicyMap:
    """Results of a policy for M targets, the centres of a grid over the opponent's half."""

    speed_mps: float
    serves: int
    """Serves per target."""
    targets_m: Array
    """(M, 2) world, in the table's plane."""
    cell_m: tuple[float, float]
    """Sides of a cell along x and y."""
    landings_m: Array
    """(M, 2) mean landing point, net and table ignored, of the balls that the racket met; NaN where it met none."""
    returned: Array
    """(M,) share of the serves that came back onto the opponent's half, 0 to 1."""
    missed: Array
    """(M,) share that the racket did not meet."""
    errors_mm: Array
    """(M,) mean distance of landing and target over all serves, `MISSED_MM` for one that the racket did not meet."""
    trained: TrainedTargets
    known_exactly: bool
    """Whether the map uses true states although the policy was trained with cameras, which are not rendered here."""

    @property
    def inside(self) -> NDArray[np.bool_]:
        """(M,) whether each target is inside the trained box."""
        return np.asarray(
            ((self.targets_m >= self.trained.low_m) & (self.targets_m <= self.trained.high_m)).all(axis=1)
        )


def target_grid() -> tuple[Array, tuple[float, float]]:
    """Targets (M, 2) in the middles of the cells over the opponent's half, x fastest, and a cell's sides in m."""
    cell = TABLE_LENGTH_M / 2 / ALONG, TABLE_WIDTH_M / ACROSS
    xs = (np.arange(ALONG) + 0.5) * cell[0]
    ys = (np.arange(ACROSS) + 0.5) * cell[1] - TABLE_WIDTH_M / 2
    return np.array([(x, y) for y in ys for x in xs]), cell


def trained_targets(goal: GoalConfig) -> TrainedTargets:
    """Targets of a training."""
    if goal.kind == "fixed":
        return TrainedTargets(goal.centre_m, goal.centre_m)
    return TrainedTargets((goal.low_x_m, -goal.half_width_m), (goal.high_x_m, goal.half_width_m))


def map_policy(
    policy: ActionSource, environment: EnvironmentConfig, speed_mps: float, serves: int = SERVES
) -> PolicyMap:
    """Play every target of the grid with the same fixed serves of a speed, without noise on the action.

    The balls are seen as in the training, but for event cameras, which are not rendered: there the state is known. Of
    recorded balls those are served that a run's best policy is chosen by.

    Args:
        policy: what chooses the action for states (N, S), racket speeds (N,) and goals (N, 2).
        environment: the task that it was trained for.
        speed_mps: of the serves at the launcher.
        serves: how many; the same for every target.

    Raises:
        ConfigError: if there are no serves of this speed, no recorded balls, or the policy needs another kind of state.
        RecordingError: if recorded balls cannot be read.
    """
    by_cameras = environment.state_source == "events"
    task = dataclasses.replace(
        environment,
        state_source="truth" if by_cameras else environment.state_source,
        outcomes="told",
        engine="closed-form",
    )
    rng = np.random.default_rng([MAP_SEED, round(1000 * speed_mps)])
    drawn = draw_serve_batch(speed_mps, serves, task, rng, "validation")
    targets, cell = target_grid()
    count = len(drawn)  # of recorded balls there may be fewer
    balls = dataclasses.replace(
        drawn[np.tile(np.arange(count), len(targets))], goals_m=np.repeat(targets, count, axis=0)
    )
    outcomes = play(balls, policy(balls.states, balls.racket_speeds_mps, balls.goals_m), task)
    errors_mm = landing_errors_mm(outcomes, balls.goals_m).reshape(-1, count)
    missed = (outcomes.case == Case.MISSED).reshape(-1, count)
    landings = outcomes.landings_m.reshape(-1, count, 2)
    met = np.asarray(np.isfinite(landings).all(axis=2))
    sums = np.where(met[:, :, None], landings, 0.0).sum(axis=1)
    means = sums / np.maximum(met.sum(axis=1), 1)[:, None]
    return PolicyMap(
        speed_mps,
        count,
        targets,
        cell,
        np.where((met.sum(axis=1) > 0)[:, None], means, np.nan),
        outcomes.returned.reshape(-1, count).mean(axis=1),
        missed.mean(axis=1),
        np.where(np.isnan(errors_mm), MISSED_MM, errors_mm).mean(axis=1),
        trained_targets(environment.goal),
        by_cameras,
    )
