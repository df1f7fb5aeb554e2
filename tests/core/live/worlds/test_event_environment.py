"""The task through simulated events: the state is near the truth, and the stroke does what the closed form says."""

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

from core.learning.config import CurriculumConfig, EnvironmentConfig, default_run
from core.learning.runs.training import Training
from core.learning.task.environment import ServeBatch, evaluation_balls, play
from core.live.worlds.event_environment import EventCameraBackend, event_environment
from core.live.worlds.world import WorldConfig
from core.physics.episode import Case, Outcomes
from core.simulation import SceneConfig, StereoConfig

pytestmark = pytest.mark.numeric
EVENTS = EnvironmentConfig(state_source="events")
STROKES = np.array([[0.0, 0.0, 0.0], [0.3, -0.6, 0.5], [0.0, 0.9, -0.4]])


@pytest.fixture(scope="module")
def backend() -> Iterator[EventCameraBackend]:
    backend = EventCameraBackend(EVENTS)
    yield backend
    backend.close()


@pytest.fixture(scope="module")
def played(backend: EventCameraBackend) -> list[tuple[ServeBatch, Outcomes]]:
    """Three balls at 5 m/s with a stroke each."""
    balls = evaluation_balls(5.0, len(STROKES), EVENTS)
    found = []
    for i, action in enumerate(STROKES):
        ball = backend.observe(balls[i : i + 1])
        found.append((ball, backend.play(ball, action[None])))
    return found


@pytest.mark.gate
def test_what_the_cameras_see_is_near_the_truth(played: list[tuple[ServeBatch, Outcomes]]) -> None:
    for ball, _ in played:
        assert ball.seen[0] and ball.aim_t_s is not None
        off = (ball.states - ball.arrivals.observations)[0]
        assert np.abs(off[:3]).max() < 0.02 and np.abs(off[3:]).max() < 0.3
        assert off.any(), "the truth itself was given"
        assert abs(ball.aim_t_s[0] - ball.arrivals.t_s[0]) < 0.005


def test_the_world_gives_the_outcome_of_the_closed_form(played: list[tuple[ServeBatch, Outcomes]]) -> None:
    for (ball, outcome), action in zip(played, STROKES, strict=True):
        expected = play(ball, action[None], EVENTS)
        assert outcome.case[0] == expected.case[0]
        np.testing.assert_allclose(outcome.landings_m, expected.landings_m, atol=1e-3)
        np.testing.assert_allclose(outcome.net_z_m, expected.net_z_m, atol=1e-3)


def test_an_equal_seed_sees_equal_balls_and_another_one_other_noise(backend: EventCameraBackend) -> None:
    ball = evaluation_balls(5.0, 1, EVENTS)
    seen = []
    for seed in (1, 1, 2):
        backend.begin(seed)
        seen.append(backend.observe(ball).states)
    np.testing.assert_array_equal(seen[0], seen[1])
    assert not np.array_equal(seen[0], seen[2])


def test_the_environment_has_gymnasium_s_interface() -> None:
    environment = event_environment(5.0)
    observation, _ = environment.reset(seed=3)
    assert environment.observation_space.contains(observation)
    again, reward, terminated, truncated, about = environment.step(np.zeros(3, np.float32))
    assert environment.observation_space.contains(again)
    assert terminated and not truncated and np.isfinite(reward)
    assert about["case"] in set(Case)
    environment.close()


def test_a_ball_that_nobody_sees_is_missed_and_teaches_nothing() -> None:
    dark = SceneConfig(ball=0.12, table=0.12, line=0.12, floor=0.12, wall=0.12, net=0.12, ambient=1.0, shadow=0.0)
    backend = EventCameraBackend(EVENTS, world=WorldConfig(stereo=StereoConfig(scene=dark)))
    curriculum = CurriculumConfig(speeds_mps=(5.0,), episodes=(2,), replay="retain")
    config = dataclasses.replace(default_run("landing-model"), environment=EVENTS, curriculum=curriculum)
    training = Training(config, 0, backend)
    line = training.play_episode()
    backend.close()
    assert line["case"] == Case.MISSED and line["buffer"] == 0 and line["reward"] == -1
