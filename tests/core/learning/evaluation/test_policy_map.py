"""A policy's map is what playing its targets one by one gives, and says where a policy was never trained."""

import dataclasses

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.config import EnvironmentConfig, GoalConfig, environment_profile
from core.learning.evaluation.policy_evaluator import MISSED_MM
from core.learning.evaluation.policy_map import MAP_SEED, map_policy, target_grid
from core.learning.task.environment import ServeBatch, draw_serve_batch, evaluation_balls, play, validation_balls
from core.table import TABLE_LENGTH_M, TABLE_WIDTH_M

pytestmark = pytest.mark.numeric
KNOWN = environment_profile(state_source="truth")
NOISY = environment_profile(state_source="truth+noise")


def aims_roughly(states: np.ndarray, racket_speeds_mps: np.ndarray, goals_m: np.ndarray) -> np.ndarray:
    """A hand-made policy that turns the racket towards the target's side, and opens it for a far one."""
    turn = np.clip(goals_m[:, 1], -1, 1)
    return np.column_stack([np.zeros(len(states)), 0.4 * (goals_m[:, 0] - 0.7), 0.5 * turn])


def serves_of(environment: EnvironmentConfig) -> ServeBatch:
    return draw_serve_batch(5.0, 12, environment, np.random.default_rng([MAP_SEED, 5000]), "validation")


def test_the_grid_covers_the_opponents_half_and_nothing_else() -> None:
    targets, cell = target_grid()
    assert len(np.unique(targets, axis=0)) == len(targets)
    assert np.isclose(len(targets) * cell[0] * cell[1], TABLE_LENGTH_M / 2 * TABLE_WIDTH_M)
    low, high = targets - np.array(cell) / 2, targets + np.array(cell) / 2
    assert np.allclose([low.min(0), high.max(0)], [[0, -TABLE_WIDTH_M / 2], [TABLE_LENGTH_M / 2, TABLE_WIDTH_M / 2]])


@pytest.mark.parametrize("environment", [KNOWN, NOISY], ids=["known", "noisy"])
def test_a_cell_is_what_its_target_alone_gives(environment: EnvironmentConfig) -> None:
    found = map_policy(aims_roughly, environment, 5.0, 12)
    balls = serves_of(environment)
    for cell in (0, 10, 37, 55):
        goals = np.tile(found.targets_m[cell], (12, 1))
        outcomes = play(
            dataclasses.replace(balls, goals_m=goals), aims_roughly(balls.states, np.zeros(12), goals), environment
        )
        errors_mm = 1000 * np.linalg.norm(outcomes.landings_m - goals, axis=1)
        assert found.errors_mm[cell] == pytest.approx(np.where(np.isnan(errors_mm), MISSED_MM, errors_mm).mean())
        assert found.returned[cell] == outcomes.returned.mean()
        assert found.landings_m[cell] == pytest.approx(np.nanmean(outcomes.landings_m, axis=0))


def test_the_same_serves_go_to_every_target_and_every_map_is_the_same() -> None:
    def ignores_the_target(states: np.ndarray, racket_speeds_mps: np.ndarray, goals_m: np.ndarray) -> np.ndarray:
        return np.zeros((len(states), 3))

    found = map_policy(ignores_the_target, NOISY, 5.0, 12)
    assert np.ptp(found.landings_m, axis=0) == pytest.approx(0.0, abs=1e-9) and np.ptp(found.returned) == 0
    assert np.ptp(found.errors_mm) > 300  # but the targets are not at the same distance
    again = map_policy(ignores_the_target, NOISY, 5.0, 12)
    assert np.array_equal(again.errors_mm, found.errors_mm)


def test_the_serves_are_those_of_no_training_and_no_evaluation() -> None:
    ours = {tuple(row) for row in serves_of(KNOWN).serves.states().round(9).tolist()}
    others = [evaluation_balls(5.0, 500, KNOWN), validation_balls(5.0, 500, KNOWN)]
    others += [draw_serve_batch(5.0, 500, KNOWN, np.random.default_rng([seed, 0, 0])) for seed in range(5)]
    for drawn in others:
        assert not ours & {tuple(row) for row in drawn.serves.states().round(9).tolist()}


def test_a_racket_that_is_nowhere_near_counts_as_the_tables_length() -> None:
    late = dataclasses.replace(KNOWN, state_source="truth+noise", position_noise_m=0.1, velocity_noise=0.2)
    found = map_policy(aims_roughly, late, 5.0, 24)
    some = found.missed > 0
    assert some.any()
    assert (found.errors_mm[some] >= MISSED_MM * found.missed[some]).all()
    assert np.isnan(found.landings_m[found.missed == 1]).all()


def test_it_says_on_which_targets_it_was_trained() -> None:
    box = map_policy(aims_roughly, KNOWN, 5.0, 4)
    assert not box.trained.is_one and box.trained.low_m == (0.45, -0.45) and 0 < box.inside.sum() < len(box.inside)
    one = map_policy(aims_roughly, dataclasses.replace(KNOWN, goal=GoalConfig(kind="fixed")), 5.0, 4)
    assert one.trained.is_one and one.trained.low_m == pytest.approx((0.775, 0.0))


def test_event_cameras_are_not_rendered_for_a_map_and_that_is_said() -> None:
    cameras = dataclasses.replace(KNOWN, state_source="events", outcomes="events")
    found = map_policy(aims_roughly, cameras, 5.0, 8)
    assert found.known_exactly and not map_policy(aims_roughly, KNOWN, 5.0, 8).known_exactly
    assert np.array_equal(found.errors_mm, map_policy(aims_roughly, KNOWN, 5.0, 8).errors_mm)


def test_recorded_balls_that_are_gone_are_an_error_that_can_be_told() -> None:
    with pytest.raises(ConfigError, match="no recorded balls"):
        map_policy(aims_roughly, dataclasses.replace(KNOWN, recorded="/no/such/balls.json"), 5.0)
