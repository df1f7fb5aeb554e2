"""Domain randomisation: a world of each ball, of which the learner knows nothing."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from core.errors import ConfigError
from core.learning.config import EnvironmentConfig, StateSource, environment_profile
from core.learning.randomisation import RANDOMISED, RandomisationConfig, fitted_ranges
from core.learning.task.drawn_worlds import (
    CONSTANTS,
    HIGHEST,
    LOWEST,
    draw_constants,
    sample_differing_serves,
    with_constants,
)
from core.learning.task.environment import ServeBatch, draw_serve_batch, play, validation_balls
from core.physics.config import physics_profile
from core.physics.constants_file import FittedConstants
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import fly_serves, sample_serves
from core.table import FittedConstant

pytestmark = pytest.mark.numeric
COUNT = 12


def environment(*names: str, source: StateSource = "truth", **ranges: float) -> EnvironmentConfig:
    switched: dict[str, Any] = dict.fromkeys(names, True)
    usual = environment_profile("real", state_source=source)
    return dataclasses.replace(usual, randomise=RandomisationConfig(**switched, **ranges))


def drawn(config: EnvironmentConfig, count: int = COUNT) -> ServeBatch:
    return draw_serve_batch(5.0, count, config, np.random.default_rng(3))


def test_constants_stay_within_their_ranges_and_those_that_do_not_differ_as_they_are() -> None:
    physics, ranges = physics_profile("real"), RandomisationConfig(physics=True)
    found = draw_constants(2000, physics, ranges, np.random.default_rng(0))
    assert found is not None
    low, high = found.min(axis=0), found.max(axis=0)
    assert (low[0], high[0]) == pytest.approx((0.554 * 0.76, 0.554 * 1.24), abs=1e-3)
    assert (low[1], high[1]) == pytest.approx((0.885, 1.0), abs=1e-3), "no ball leaves the table faster than it came"
    assert (low[2], high[2]) == pytest.approx((0.127, 0.327), abs=1e-3)
    assert (found[:, 3:] == [0.878, 0.819]).all()
    rubber = draw_constants(50, physics, RandomisationConfig(rubber=True), np.random.default_rng(0))
    assert rubber is not None and (rubber[:, :3] == [0.554, 0.945, 0.227]).all() and np.ptp(rubber[:, 3]) > 0.1
    assert draw_constants(5, physics, RandomisationConfig(latency=True), np.random.default_rng(0)) is None


def test_a_task_takes_the_constants_of_a_ball_and_their_bounds_are_its_own() -> None:
    for bounds in (LOWEST, HIGHEST):
        physics = with_constants(TaskConfig(), bounds).physics
        assert [getattr(getattr(physics, section), name) for section, name in CONSTANTS] == bounds.tolist()
        outside = bounds + np.where(bounds == LOWEST, -1e-6, 1e-6)
        for k in range(len(CONSTANTS)):
            with pytest.raises(ConfigError, match="out of range"):
                with_constants(TaskConfig(), np.where(np.arange(len(CONSTANTS)) == k, outside, bounds))


def test_balls_are_served_and_struck_in_their_own_world() -> None:
    config = environment("physics", "rubber")
    balls = drawn(config)
    assert balls.constants is not None and balls.arrivals.legal.all()
    outcomes = play(balls, np.zeros((COUNT, 3)), config)
    for i in range(COUNT):
        own = with_constants(config.task, balls.constants[i])
        one = balls[i : i + 1]
        np.testing.assert_array_equal(fly_serves(one.serves, own).states, one.arrivals.states)
        alone = dataclasses.replace(one, constants=None)
        there = play(alone, np.zeros((1, 3)), dataclasses.replace(config, task=own))
        np.testing.assert_array_equal(there.landing_states, outcomes.landing_states[i : i + 1])
    usual = play(dataclasses.replace(balls, constants=None), np.zeros((COUNT, 3)), config)
    assert (usual.landing_states != outcomes.landing_states).any(axis=1).all()


def test_repeated_balls_keep_their_world_whatever_their_order() -> None:
    config = environment("rubber")
    balls = drawn(config)
    which = np.random.default_rng(1).permutation(np.repeat(np.arange(COUNT), 3))
    repeated = play(balls[which], np.zeros((len(which), 3)), config)
    np.testing.assert_array_equal(repeated.landings_m, play(balls, np.zeros((COUNT, 3)), config).landings_m[which])


def test_mujoco_plays_each_ball_in_its_own_world_too() -> None:
    config = environment("physics", "rubber")
    balls, actions = drawn(config, 3), np.zeros((3, 3))
    mujoco = play(balls, actions, dataclasses.replace(config, engine="mujoco"))
    np.testing.assert_allclose(mujoco.landings_m, play(balls, actions, config).landings_m, atol=1e-4)


@pytest.mark.parametrize("name", ["latency", "rubber", "calibration"])
def test_serves_and_targets_are_those_of_the_usual_world(name: str) -> None:
    usual, other = drawn(environment()), drawn(environment(name))
    np.testing.assert_array_equal(other.goals_m, usual.goals_m)
    np.testing.assert_array_equal(other.serves.states(), usual.serves.states())


def test_where_the_air_differs_targets_are_the_usual_ones_and_no_usual_serve_is_flown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usual = drawn(environment())
    monkeypatch.delattr("core.learning.task.environment.fly_serves")
    other = drawn(environment("physics"))
    np.testing.assert_array_equal(other.goals_m, usual.goals_m)
    assert (other.serves.states() != usual.serves.states()).any(axis=1).all()


def test_a_late_racket_meets_the_ball_later_and_has_less_time_to_turn() -> None:
    usual, late = drawn(environment(), 400), drawn(environment("latency"), 400)
    assert late.aim_t_s is not None and late.aim_ps_m is not None
    by_s = late.aim_t_s - usual.arrivals.t_s
    assert 0 <= by_s.min() < 0.001 and 0.019 < by_s.max() <= 0.02
    np.testing.assert_array_equal(late.states, usual.states)
    hit_s = play(late, np.zeros((400, 3)), environment()).hit_t_s - usual.arrivals.t_s
    assert (hit_s[np.isfinite(hit_s)] > 0).all() and np.nanmax(hit_s) > 0.005
    timed, timed_late = drawn(environment(source="timed"), 3), drawn(environment("latency", source="timed"), 3)
    assert timed.turn_s is not None and timed_late.turn_s is not None
    assert (timed_late.turn_s < timed.turn_s).all()


def test_a_wrong_calibration_shifts_the_state_within_the_hitting_plane() -> None:
    config = environment("calibration", turned_deg=0.0)
    usual, seen = drawn(environment(), 400), drawn(config, 400)
    off = seen.states - usual.states
    assert np.abs(off[:, 0]).max() < 1e-9, "p_c lies in the hitting plane"
    np.testing.assert_allclose(off[:, 3:], 0, atol=1e-12)
    assert 0.004 < np.abs(off[:, 1]).max() < 0.02
    assert seen.aim_ps_m is not None and seen.aim_t_s is not None
    np.testing.assert_allclose(seen.aim_ps_m, seen.states[:, :3])
    late_s = seen.aim_t_s - usual.arrivals.t_s
    assert 0.0005 < np.abs(late_s).max() < 0.003, "5 mm along x at some 3 m/s"
    turned = drawn(environment("calibration", shifted_m=0.0), 400).states
    speed = np.linalg.norm(usual.states[:, 3:], axis=1)
    np.testing.assert_allclose(np.linalg.norm(turned[:, 3:], axis=1), speed)
    cosines = (turned[:, 3:] * usual.states[:, 3:]).sum(axis=1) / speed**2
    assert 0.3 < np.degrees(np.arccos(cosines.clip(-1, 1))).max() <= 0.5


def test_an_uncertain_racket_is_off_in_angles_and_speed_only() -> None:
    usual, off = drawn(environment(), 400), drawn(dataclasses.replace(environment(), racket="uncertain"), 400)
    assert off.speed_errors_mps is not None
    np.testing.assert_array_equal(off.states, usual.states)
    np.testing.assert_array_equal(off.racket_speeds_mps, usual.racket_speeds_mps)
    assert np.abs(15 * off.action_errors).max() == pytest.approx(1.0, abs=0.01)
    assert np.abs(off.speed_errors_mps).max() == pytest.approx(0.1, abs=0.001)
    only_speed = dataclasses.replace(off, action_errors=np.zeros_like(off.action_errors))
    played = [play(one, np.zeros((400, 3)), environment()).landings_m for one in (usual, only_speed)]
    assert (played[0] != played[1]).any(axis=1).all()


def test_points_on_the_way_are_those_of_the_ball_in_its_own_air() -> None:
    config = environment("physics")
    balls = drawn(config, 4)
    assert balls.constants is not None
    t_s = balls.arrivals.t_s[:, None] * np.linspace(0, 1, 5)
    found = sample_differing_serves(balls.serves, balls.arrivals, t_s, config.task, balls.constants)
    np.testing.assert_allclose(found[:, -1], balls.arrivals.states[:, :3], atol=1e-5)
    usual = sample_serves(balls.serves, balls.arrivals, t_s, config.task)
    assert (np.linalg.norm(found - usual, axis=2)[:, -1] > 1e-3).all()


def test_the_same_balls_are_drawn_for_every_policy() -> None:
    config = environment(*RANDOMISED)
    again = draw_serve_batch(5.0, COUNT, config, np.random.default_rng([20260405, 5000]), "validation")
    np.testing.assert_array_equal(validation_balls(5.0, COUNT, config).constants, again.constants)  # type: ignore[arg-type]


def test_fitted_constants_give_the_ranges_of_air_and_table() -> None:
    fitted = FittedConstants(FittedConstant(0.5, 0.01), FittedConstant(0.9, 0.02), FittedConstant(0.2, 9.0), 0.1)
    ranges = fitted_ranges(RandomisationConfig(rubber=True), fitted)
    assert (ranges.drag, ranges.table_restitution, ranges.table_friction) == pytest.approx((0.04, 0.04, 0.3))
    assert ranges.names == ("rubber",)


def test_what_one_world_stands_for_cannot_differ() -> None:
    with pytest.raises(ConfigError, match="cameras see one world"):
        environment("rubber", source="events")
    with pytest.raises(ConfigError, match="recorded balls come as they flew"):
        dataclasses.replace(environment("physics"), recorded="balls.json")
    dataclasses.replace(environment("rubber"), recorded="balls.json")
