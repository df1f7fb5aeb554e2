"""A policy plays the live rally with the very stroke that its training would play."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.rally.closed_loop import ClosedLoop
from core.cameras import stereo_preset
from core.errors import ConfigError
from core.learning import RunConfig, create_run
from core.learning.agents.policy import Policy, save_policy
from core.learning.config import EnvironmentConfig
from core.learning.runs.policy_controller import PolicyController, load_controller
from core.learning.runs.run_files import seed_files
from core.live.worlds.world import WorldConfig
from core.physics import TaskConfig, physics_profile
from core.physics.episode import strokes_from_actions
from core.physics.rotation import base_orientation
from core.physics.task import HIT_RULES, task_profile

pytestmark = pytest.mark.numeric
FACE_UP_DEG = -4.0
STATE = np.array([-1.42, 0.1, 0.25, -4.1, 0.2, 0.8])


def constant(tilt_deg: float) -> Policy:
    """A policy that opens the face by the same angle for every ball: 4 degrees return most of them."""
    action = np.array([0.0, tilt_deg / 15, 0.0], np.float32)
    return Policy(
        ((np.zeros((8, 3), np.float32), action),),
        "relu",
        "clip",
        False,
        np.array([2.0, 4.1], np.float32),
        np.array([3.0, 1.0], np.float32),
    )


def random_policy() -> Policy:
    rng = np.random.default_rng(2)
    layer = rng.normal(size=(8, 3)).astype(np.float32), rng.normal(size=3).astype(np.float32)
    return Policy((layer,), "relu", "tanh", False, np.array([2.0, 4.1], np.float32), np.array([3.0, 1.0], np.float32))


def test_the_stroke_is_that_of_an_episode_with_the_same_action() -> None:
    task, policy, goal = TaskConfig(), random_policy(), (0.7, 0.2)
    command = PolicyController(policy, task, goal).decide(0.6, STATE[:3], STATE[3:], stage="post")
    assert command is not None
    action = policy.act(STATE, goal)
    np.testing.assert_array_equal(command.action, action)
    strokes = strokes_from_actions(action[None], np.array([policy.racket_speed_mps(STATE)]), task.stroke)
    np.testing.assert_allclose(command.target.q_wxyz, strokes.qs_wxyz[0], atol=1e-12)
    np.testing.assert_allclose(command.target.v_mps, strokes.vs_mps[0], atol=1e-12)
    assert command.target.t_s == 0.6 and command.stage == "post"


def test_before_the_bounce_the_racket_only_moves() -> None:
    command = PolicyController(random_policy(), TaskConfig(), (0.7, 0.2)).decide(0.6, STATE[:3], STATE[3:], stage="pre")
    assert command is not None and not command.action.any()
    np.testing.assert_array_equal(command.target.q_wxyz, base_orientation(TaskConfig().stroke))


def test_a_ball_that_does_not_come_is_not_answered() -> None:
    controller = PolicyController(random_policy(), TaskConfig(), (0.7, 0.2))
    assert controller.decide(0.6, STATE[:3], -STATE[3:], stage="post") is None
    assert controller.decide(np.nan, STATE[:3], STATE[3:], stage="post") is None


def test_a_goal_beside_the_table_is_refused_and_another_one_is_aimed_at() -> None:
    controller = PolicyController(random_policy(), TaskConfig(), (0.7, 0.2), "mine")
    with pytest.raises(ConfigError, match="goal"):
        controller.aimed_at((2.0, 0.0))
    again = controller.aimed_at((0.5, -0.1))
    assert again.goal_m.tolist() == [0.5, -0.1] and again.name == "mine"
    one, other = (c.decide(0.6, STATE[:3], STATE[3:], stage="post") for c in (controller, again))
    assert one is not None and other is not None and np.abs(one.action - other.action).max() > 0.01


def test_a_policy_keeps_to_what_it_was_trained_with() -> None:
    controller = PolicyController(random_policy(), TaskConfig(), (0.7, 0.2))
    assert controller.for_physics(physics_profile("real")) is controller


@pytest.mark.gate
def test_a_run_folder_plays_balls_through_perception(tmp_path: Path) -> None:
    run = tmp_path / "open-face"
    create_run(run, RunConfig())
    with pytest.raises(ConfigError, match="without a policy"):
        load_controller(run)
    seed_files(run, 0).folder.mkdir()
    save_policy(constant(FACE_UP_DEG), seed_files(run, 0).policy)
    controller = load_controller(run)
    assert controller.name == "open-face" and controller.goal_m.tolist() == pytest.approx([0.775, 0.0])
    loop = ClosedLoop(WorldConfig(), stereo_preset(), seed=5, controller=controller)
    try:
        balls = [loop.play(5.0) for _ in range(2)]
    finally:
        loop.close()
    assert all(ball.returned for ball in balls)
    assert all(ball.decisions[-1].action[1] == pytest.approx(FACE_UP_DEG / 15) for ball in balls)


def spin_policy() -> Policy:
    rng = np.random.default_rng(2)
    layer = rng.normal(size=(14, 3)).astype(np.float32), rng.normal(size=3).astype(np.float32)
    table = np.array([2.0, 4.1], np.float32), np.array([3.0, 1.0], np.float32)
    return Policy((layer,), "relu", "tanh", False, *table, "spin")


def test_a_policy_that_was_trained_with_spin_uses_it_and_answers_no_ball_without() -> None:
    controller = PolicyController(spin_policy(), TaskConfig(), (0.7, 0.2))
    assert controller.needs_spin and not PolicyController(random_policy(), TaskConfig(), (0.7, 0.2)).needs_spin
    spin, sigma = np.array([10.0, -140.0, 20.0]), np.array([4.0, 5.0, 6.0])
    told = {"stage": "post", "spin_radps": spin, "spin_sigma_radps": sigma}
    command = controller.decide(0.6, STATE[:3], STATE[3:], **told)  # type: ignore[arg-type]
    assert command is not None
    expected = spin_policy().act(np.concatenate([STATE, spin, sigma]), (0.7, 0.2))
    np.testing.assert_array_equal(command.action, expected)
    np.testing.assert_array_equal(command.state, STATE)
    assert controller.decide(0.6, STATE[:3], STATE[3:], stage="post") is None


def test_a_policy_of_another_kind_than_its_run_is_refused(tmp_path: Path) -> None:
    create_run(tmp_path / "run", RunConfig())
    save_policy(spin_policy(), seed_files(tmp_path / "run", 0).policy)
    with pytest.raises(ConfigError, match="other states than its run has"):
        load_controller(tmp_path / "run")


def test_a_policy_that_was_trained_where_the_hit_is_chosen_plays_so_and_others_at_the_plane(tmp_path: Path) -> None:
    task = task_profile("real")
    found = {}
    for hit in HIT_RULES:
        run = tmp_path / hit
        create_run(run, RunConfig(environment=EnvironmentConfig(task=task, state_source="truth", hit=hit)))
        save_policy(constant(FACE_UP_DEG), seed_files(run, 0).policy)
        controller = load_controller(run).aimed_at((0.8, 0.0))
        assert (controller.strokes() is not None) == (hit == "chosen")
        world = WorldConfig(task=task)
        loop = ClosedLoop(world, stereo_preset(), seed=5, controller=controller, hit="chosen", point_sigma_m=0.0008)
        try:
            found[hit] = loop.play(3.0)
        finally:
            loop.close()
    assert found["paper"].choice is None and found["chosen"].choice is not None
    assert found["paper"].decisions[-1].state[0] == pytest.approx(-1.42, abs=1e-6)
