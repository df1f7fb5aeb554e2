"""The Gymnasium environment: registered, checked, seeded, one step an episode, and the same in one batch."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_for_sb3

from core.errors import AgentError, ConfigError
from core.learning import default_run
from core.learning.config import EnvironmentConfig, RewardConfig
from core.learning.gym_environment import ENVIRONMENT_ID, RETURN_ID, OneStepReturn
from core.learning.rewards import REWARDS, Reward, placing_only
from core.learning.runs.training import Training
from core.learning.task.environment import draw_serve_batch, play
from core.learning.task.reward import episode_rewards, reward_weights
from core.learning.vector_environment import VectorReturn
from core.physics.episode import Case
from core.physics.task import task_profile

pytestmark = pytest.mark.numeric
ROOT = Path(__file__).parents[3]
TRUTH = EnvironmentConfig(state_source="truth")
KINDS = {
    "as it is": {},
    "the racket's speed chosen": {"racket": "chosen"},
    "with spin": {"environment": EnvironmentConfig(state_source="truth", state="spin")},
    "noisy": {"environment": EnvironmentConfig(state_source="truth+noise")},
}


@pytest.mark.parametrize("kind", KINDS)
def test_both_checkers_are_content_without_a_warning(kind: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        environment = gymnasium.make(RETURN_ID, **KINDS[kind])
        check_env(environment.unwrapped)
        check_for_sb3(environment.unwrapped)


@pytest.mark.parametrize(
    "code",
    [
        f"import core.learning.gym_environment; gymnasium.make('{RETURN_ID}').reset()",
        f"gymnasium.make('core.learning.gym_environment:{RETURN_ID}').reset()",
        f"gymnasium.make_vec('core.learning.gym_environment:{RETURN_ID}', num_envs=2).reset()",
        f"import core.learning.gym_environment; gymnasium.make('{ENVIRONMENT_ID}').reset()",
    ],
)
def test_it_is_made_by_its_name_in_a_new_process(code: str) -> None:
    subprocess.run([sys.executable, "-W", "error", "-c", f"import gymnasium; {code}"], check=True, cwd=ROOT)


def test_a_chosen_racket_is_a_fourth_number_that_counts() -> None:
    environment = gymnasium.make(RETURN_ID, racket="chosen")
    assert environment.action_space.shape == (4,)
    landings = []
    for speed in (-1.0, 1.0):
        environment.reset(seed=4)
        landings.append(environment.step(np.array([0, 0, 0, speed], np.float32))[4]["landing_m"][0])
    assert landings[1] > landings[0] + 0.2, "a faster racket plays farther"
    assert gymnasium.make_vec(RETURN_ID, num_envs=3, racket="chosen").action_space.shape == (3, 4)


def test_balls_are_met_where_they_are_chosen_to_be_in_both_kinds_of_environment() -> None:
    task = EnvironmentConfig(task=task_profile("real"), state_source="truth")
    environment = OneStepReturn(3.0, task, hit="chosen")
    first = {round(float(environment.reset(seed=4 if k == 0 else None)[0][0]), 3) for k in range(12)}
    assert len(first) > 1, "x of the place, which at the plane is always the same"
    vector = VectorReturn(12, 3.0, task, hit="chosen")
    assert len(set(vector.reset(seed=4)[0][:, 0].round(3).tolist())) > 1
    assert OneStepReturn(3.0, task).environment.hit == "paper"


def test_a_step_after_the_end_or_before_a_reset_is_refused() -> None:
    environment = OneStepReturn()
    action = np.zeros(3, np.float32)
    with pytest.raises(ResetNeeded, match="before the first reset"):
        environment.step(action)
    environment.reset(seed=0)
    environment.step(action)
    with pytest.raises(ResetNeeded, match="after the end"):
        environment.step(action)
    environment.reset()
    environment.step(action)
    with pytest.raises(ResetNeeded, match="before the first reset"):
        VectorReturn(2).step(np.zeros((2, 3), np.float32))


def test_info_has_the_case_and_the_landing() -> None:
    environment = OneStepReturn()
    rng = np.random.default_rng(1)
    found = set()
    environment.reset(seed=1)
    for _ in range(200):
        _, _, _, _, info = environment.step(rng.uniform(-1, 1, 3).astype(np.float32))
        found.add(info["case"])
        assert info["is_returned"] == (info["case"] == Case.RETURNED)
        assert info["landing_m"].shape == (2,) and np.isfinite(info["landing_m"]).all()
        environment.reset()
    assert {Case.RETURNED, Case.NET, Case.OUT} <= found


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_an_action_that_is_no_number_names_the_agent_and_the_episode(value: float) -> None:
    environment = OneStepReturn()
    environment.reset(seed=0)
    environment.step(np.zeros(3, np.float32))
    environment.reset()
    with pytest.raises(AgentError, match=r"episode 1: the agent gave an action that is no number.*got \[0\.0,"):
        environment.step(np.array([0, value, 0], np.float32))
    copies = VectorReturn(3)
    copies.reset(seed=0)
    actions = np.zeros((3, 3), np.float32)
    actions[2, 1] = value
    with pytest.raises(AgentError, match="episode 0: the agent in copy 2 gave an action that is no number"):
        copies.step(actions)
    balls = draw_serve_batch(5.0, 3, TRUTH, np.random.default_rng(0))
    with pytest.raises(AgentError, match="episode 2: the agent"):
        play(balls, actions.astype(np.float64), TRUTH)


def test_an_action_of_another_shape_is_refused() -> None:
    environment = OneStepReturn()
    environment.reset(seed=0)
    for action in (np.zeros(4, np.float32), np.zeros((1, 3), np.float32), np.float32(0.0)):
        with pytest.raises(AgentError, match="another shape"):
            environment.step(action)  # type: ignore[arg-type]
    copies = VectorReturn(2)
    copies.reset(seed=0)
    with pytest.raises(AgentError, match="another shape"):
        copies.step(np.zeros((3, 3), np.float32))


def test_a_reward_that_is_no_number_names_itself_and_the_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    def of_landing(strokes, weights, config):
        return np.where(strokes.case == Case.RETURNED, 1.0, np.nan)

    def of_half(strokes, weights, config):
        return np.ones(max(0, len(strokes.case) - 1))

    for name, rewards in (("odd", of_landing), ("short", of_half)):
        monkeypatch.setitem(REWARDS._items, name, Reward(rewards, "a test's", placing_only, None))
    environment = OneStepReturn(reward=RewardConfig(kind="odd"))
    environment.reset(seed=0)
    said = r"episode 0, stroke 0, own half: the reward odd is no number; expected a finite number, got nan"
    with pytest.raises(AgentError, match=said):
        environment.step(np.array([1, 1, 1], np.float32))
    copies = VectorReturn(4, reward="short")
    copies.reset(seed=0)
    with pytest.raises(AgentError, match="the reward short is no number; expected 4 numbers"):
        copies.step(np.zeros((4, 3), np.float32))


def test_the_batch_plays_as_the_task_does_and_resets_itself() -> None:
    copies = gymnasium.make_vec(RETURN_ID, num_envs=5, reward=RewardConfig(kind="cdta"))
    assert isinstance(copies.unwrapped, VectorReturn)
    seen, _ = copies.reset(seed=3)
    again, _ = gymnasium.make_vec(RETURN_ID, num_envs=5).reset(seed=3)
    assert seen.dtype == np.float32 and np.array_equal(seen, again) and len(np.unique(seen[:, 1])) == 5
    rng = np.random.default_rng(0)
    for episode in range(3):
        balls = copies.unwrapped._now
        assert balls is not None
        actions = rng.uniform(-1, 1, (5, 3)).astype(np.float32)
        following, rewards, ended, cut, infos = copies.step(actions)
        outcomes = play(balls, actions.astype(np.float64), TRUTH)
        reward = RewardConfig(kind="cdta")
        expected = episode_rewards(outcomes, balls.goals_m, reward_weights(episode, reward), reward)
        assert rewards == pytest.approx(expected) and ended.all() and not cut.any()
        assert infos["case"].tolist() == outcomes.case.tolist() and infos["_case"].all()
        assert infos["final_info"]["landing_m"] == pytest.approx(outcomes.landings_m, nan_ok=True)
        assert np.array_equal(infos["final_obs"], seen) and not np.array_equal(following, seen)
        seen = following


def test_a_batch_larger_than_what_is_dealt_at_once_goes_on_for_ever() -> None:
    copies = VectorReturn(5000)
    first, _ = copies.reset(seed=0)
    second = copies.step(np.zeros((5000, 3), np.float32))[0]
    third = copies.step(np.zeros((5000, 3), np.float32))[0]
    assert len(np.unique(np.concatenate([first, second, third])[:, 1])) > 14_000


def test_what_cannot_be_made_is_refused_by_its_name() -> None:
    for call, said in (
        (lambda: VectorReturn(0), "num_envs"),
        (lambda: OneStepReturn(reward="most"), "most"),
        (lambda: VectorReturn(2, environment=EnvironmentConfig(state_source="events")), "state_source"),
        (lambda: VectorReturn(2).reset(seed=[1, 2]), "seed"),  # type: ignore[arg-type]
        (lambda: OneStepReturn(speed_mps=float("nan")).reset(seed=0), "speed"),
    ):
        with pytest.raises(ConfigError, match=said):
            call()


def test_training_stops_at_an_action_that_is_no_number() -> None:
    config = default_run("ddpg")
    training = Training(config, 3)
    for _ in range(config.exploration.random_episodes + 2):
        training.play_episode()
    training._agent.act = lambda *seen: np.full((1, 3), np.nan)  # type: ignore[method-assign]
    at = training.episode
    with pytest.raises(AgentError, match=f"episode {at}: the agent ddpg, seed 3, gave an action that is no number"):
        training.play_episode()


def test_the_example_of_the_page_trains_with_stable_baselines() -> None:
    page = (ROOT / "docs/use/environment.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", page.split("## Train with stable-baselines3")[1], re.S)
    assert 5 <= len(example.strip().splitlines()) <= 12
    scope: dict[str, object] = {}
    exec(compile(example.replace("total_timesteps=2000", "total_timesteps=64"), "environment.md", "exec"), scope)
    assert 0 <= float(scope["returned"]) <= 1  # type: ignore[arg-type]
