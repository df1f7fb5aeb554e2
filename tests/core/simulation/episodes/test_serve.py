"""Serves: legal, seeded, and as the config says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics.task import STAGE_SPEEDS_MPS, ServeConfig, TaskConfig, hard_serves, task_profile
from core.simulation.episodes.closed_form import draw_serves, fly_serves

pytestmark = pytest.mark.numeric
PAPER = task_profile("paper")
HARD = dataclasses.replace(PAPER, serve=hard_serves())


@pytest.mark.parametrize("task", [PAPER, HARD, task_profile("real")], ids=["standard", "hard", "real"])
@pytest.mark.parametrize("speed", STAGE_SPEEDS_MPS)
def test_every_serve_bounces_once_on_the_robot_s_half_and_reaches_the_hitting_plane(
    task: TaskConfig, speed: float
) -> None:
    serves = draw_serves(speed, 50, task, np.random.default_rng(0))
    arrivals = fly_serves(serves, task)
    assert len(serves) == 50
    assert arrivals.legal.all()
    assert (np.abs(arrivals.bounce_states[:, 0] + 0.685) <= 0.685).all()
    assert arrivals.states[:, 0] == pytest.approx(np.full(50, -1.42))
    assert (arrivals.t_s > arrivals.bounce_t_s).all()


def test_the_same_seed_gives_the_same_serves_and_another_seed_others() -> None:
    first, again, other = (draw_serves(5.0, 20, HARD, np.random.default_rng(seed)).states() for seed in (4, 4, 5))
    assert (first == again).all()
    assert (first != other).any()


def test_standard_serves_fly_straight_with_one_speed_and_no_spin() -> None:
    serves = draw_serves(5.0, 100, PAPER, np.random.default_rng(1))
    assert np.linalg.norm(serves.vs_mps, axis=1) == pytest.approx(np.full(100, 5.0))
    assert (serves.vs_mps[:, 1] == 0).all() and (serves.spins_radps == 0).all()
    assert (np.abs(serves.ps_m[:, 1]) <= 0.35).all()
    assert 0.28 <= serves.ps_m[:, 2].min() < 0.30 and 0.40 < serves.ps_m[:, 2].max() <= 0.42


def test_hard_serves_vary_in_direction_elevation_and_speed_and_arrive_where_they_aim() -> None:
    serves = draw_serves(5.0, 300, HARD, np.random.default_rng(1))
    speed = np.linalg.norm(serves.vs_mps, axis=1)
    elevation = np.degrees(np.arcsin(serves.vs_mps[:, 2] / speed))
    assert 4.75 <= speed.min() < 4.8 and 5.2 < speed.max() <= 5.25
    assert 10 <= elevation.min() < 10.5 and 13.5 < elevation.max() <= 14
    arrive_y = fly_serves(serves, HARD).states[:, 1]
    assert np.abs(arrive_y).max() <= 0.351
    assert np.corrcoef(arrive_y, serves.ps_m[:, 1])[0, 1] < 0.2


def test_fast_serves_from_low_are_drawn_again_when_they_would_touch_the_net() -> None:
    anything = dataclasses.replace(PAPER, serve=ServeConfig(only_legal=False))
    legal = fly_serves(draw_serves(9.0, 400, anything, np.random.default_rng(0)), PAPER).legal
    assert 0.6 < legal.mean() < 0.9


def test_speeds_between_the_stages_are_interpolated() -> None:
    serve = ServeConfig()
    assert np.degrees(serve.elevation.at(3.5)) == pytest.approx(21.5)
    assert PAPER.stroke.racket_speed.at(8.5) == pytest.approx(-0.8)


def test_impossible_serves_are_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match="3 to 9 m/s"):
        draw_serves(12.0, 1, PAPER, np.random.default_rng(0))
    behind_the_net = dataclasses.replace(PAPER, serve=ServeConfig(height_low_m=0.05, height_high_m=0.05))
    with pytest.raises(ConfigError, match="no legal serves"):
        draw_serves(9.0, 10, behind_the_net, np.random.default_rng(0))
