"""The continuous path of an episode."""

from __future__ import annotations

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics import strokes_from_actions
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves, simulate_episodes
from core.simulation.episodes.episode_path import Trajectory, rebound_from_wall, trace_episode

pytestmark = pytest.mark.numeric


def random_path(profile: str, seed: int) -> tuple[Trajectory, float]:
    task = task_profile("real" if profile == "real" else "paper")
    rng = np.random.default_rng(seed)
    serves = draw_serves(5.0, 1, task, rng)
    strokes = strokes_from_actions(rng.uniform(-1, 1, (1, 3)), task.stroke.racket_speed.at(5.0), task.stroke)
    return trace_episode(serves, strokes, task), float(simulate_episodes(serves, strokes, task).contact_t_s[0])


@pytest.mark.parametrize("profile", ["paper", "real"])
def test_the_path_is_continuous_and_its_velocity_is_its_derivative(profile: str) -> None:
    for seed in range(5):
        path, _ = random_path(profile, seed)
        impacts = np.array([event.t_s for event in path.events])
        times = np.linspace(0.01, path.end_s - 0.01, 400)
        away = np.abs(times[:, None] - impacts).min(axis=1) > 2e-5
        slope = (path.at(times + 1e-5)[:, :3] - path.at(times - 1e-5)[:, :3]) / 2e-5
        assert slope[away] == pytest.approx(path.at(times)[away, 3:6], abs=1e-4)
        for t in impacts[1:]:
            assert path.at(t - 1e-9)[:3] == pytest.approx(path.at(t)[:3], abs=2e-6)


@pytest.mark.parametrize("profile", ["paper", "real"])
def test_the_events_come_in_the_order_of_play(profile: str) -> None:
    for seed in range(10):
        path, contact_t = random_path(profile, seed)
        kinds = [event.kind for event in path.events]
        assert kinds[:3] == ["serve", "bounce", "hit"]
        assert path.events[3].t_s == pytest.approx(contact_t, abs=1e-9)
        assert (np.diff([event.t_s for event in path.events]) > 0).all()


def test_the_ball_never_sinks_below_table_or_floor() -> None:
    for seed in range(20):
        path, _ = random_path("real", seed)
        states = path.at(np.linspace(0, 3, 3000))
        over = (np.abs(states[:, 0]) < 1.369) & (np.abs(states[:, 1]) < 0.762)
        assert states[over, 2].min() >= 0.02 - 1e-6
        assert states[:, 2].min() >= -0.74 - 1e-6


def test_outside_its_time_the_path_holds_still() -> None:
    path, _ = random_path("paper", 1)
    assert (path.at(-5.0) == path.at(0.0)).all()
    assert (path.at(99.0) == path.at(path.end_s)).all()
    assert path.at(np.zeros((2, 3))).shape == (2, 3, 9)


def test_a_path_has_exactly_one_serve() -> None:
    task = task_profile("paper")
    with pytest.raises(ConfigError, match="one serve"):
        trace_episode(draw_serves(5.0, 2, task, np.random.default_rng(0)), None, task)


@pytest.mark.parametrize("heading", [-1, 1])
def test_a_ball_that_the_net_stops_is_put_on_the_side_from_which_it_came(heading: int) -> None:
    task = task_profile("paper")
    state = np.array([0.0, 0.1, 0.2, 4.0 * heading, 1.0, -2.0, 10.0, 20.0, 30.0])
    rebound_from_wall(state, task)
    assert state[0] * heading < 0 and state[3] == -4.0 * heading * task.physics.net_restitution
    np.testing.assert_allclose(state[4:], np.array([1.0, -2.0, 10.0, 20.0, 30.0]) * (1 - task.physics.net_drag))
