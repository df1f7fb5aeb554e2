"""A policy learns from the strokes that it plays: the real landing model, on balls that the training's task draws."""

from __future__ import annotations

import dataclasses
import math
import threading
from pathlib import Path

import numpy as np
import pytest

from core.chain.control.controller import LiveController
from core.errors import ConfigError
from core.learning.agents.policy import Policy
from core.learning.config import EnvironmentConfig, default_run
from core.learning.runs.policy_controller import PolicyController
from core.learning.runs.run_files import create_run, load_checkpoint, load_policy, read_run, seed_files
from core.learning.runs.running import run_training
from core.learning.runs.training import Training
from core.learning.task.environment import ClosedFormBackend, ServeBatch, draw_serve_batch, play
from core.live.live_snapshot import FinishedBall
from core.online_learning.learner import OnlineLearner
from core.online_learning.start import NOTHING, can_start_from, start_from_nothing, start_from_run
from core.physics import TaskConfig
from core.physics.episode import Case
from tests.waiting import eventually

pytestmark = pytest.mark.numeric
ENVIRONMENT = EnvironmentConfig(state_source="truth")
GOAL = np.array([0.8, 0.0])
BETWEEN_S = 2.0


@pytest.fixture
def learner():
    one = OnlineLearner()
    one.reset(start_from_nothing())
    yield one
    one.close()


def drawn(count: int, seed: int = 3) -> ServeBatch:
    return draw_serve_batch(5.0, count, ENVIRONMENT, np.random.default_rng(seed))


def played(balls: ServeBatch, number: int, controller: LiveController) -> FinishedBall:
    """One ball as the live rally plays and tells it."""
    state = balls.states[number]
    served_s = BETWEEN_S * number
    for stage in ("pre", "post", "post"):
        decision = controller.decide(served_s + 0.6, state[:3], state[3:], stage=stage)
        assert decision is not None
    one = balls[number : number + 1]
    outcome = play(one, decision.action[None], ENVIRONMENT)
    return FinishedBall(
        t_us=round(1e6 * (served_s + 1.0)),
        serve_us=round(1e6 * served_s),
        speed_mps=5.0,
        case=Case(int(outcome.case[0])),
        landing_m=outcome.landings_m[0],
        goal_m=decision.goal_m,
        net_z_m=float(outcome.net_z_m[0]),
        decision=dataclasses.replace(decision, t_us=round(1e6 * (served_s + 0.5))),
    )


def play_on(learner: OnlineLearner, count: int, seed: int = 3) -> None:
    """Balls one after the other, each learned from before the next is served."""
    balls, controller = drawn(count, seed), learner.controller(GOAL)
    before = balls_of(learner)
    for number in range(count):
        learner.note(played(balls, number, controller))
        wait_for_balls(learner, before + number + 1)


def balls_of(learner: OnlineLearner) -> int:
    assert learner.progress is not None
    return len(learner.progress.balls)


def wait_for_balls(learner: OnlineLearner, count: int) -> None:
    eventually(lambda: balls_of(learner) >= count, "the ball to be learned from", lambda: learner.progress)


def median_error_mm(policy: Policy) -> float:
    """On balls that it has not met."""
    balls = drawn(200, seed=99)
    goals = np.tile(GOAL, (200, 1))
    outcomes = play(balls, policy(balls.states, balls.racket_speeds_mps, goals), ENVIRONMENT)
    return 1000 * float(np.median(np.hypot(*(outcomes.landings_m - GOAL).T)))


def test_each_ball_improves_the_policy_and_a_reset_forgets_it_all(learner) -> None:
    began, layers = median_error_mm(learner.policy), learner.policy.layers
    play_on(learner, 60)
    assert median_error_mm(learner.policy) < min(80.0, began / 4)
    progress = learner.progress
    assert progress.learned == 60 and progress.start == NOTHING
    assert [ball.random for ball in progress.balls] == [True] * 10 + [False] * 50
    assert progress.returned > 40 and progress.returned_lately == (10, 10)
    _, medians = progress.errors_mm()
    assert medians[-1] < 100 and not medians[9] < medians[-1]
    learner.reset(start_from_nothing())
    assert learner.progress.balls == () and learner.progress.learned == 0
    for again, (weight, bias) in zip(learner.policy.layers, layers, strict=True):
        np.testing.assert_array_equal(again[0], weight)
        np.testing.assert_array_equal(again[1], bias)


def test_a_stroke_that_another_policy_played_is_not_learned_from(learner) -> None:
    balls = drawn(3)
    other = PolicyController(learner.policy, TaskConfig(), GOAL)
    learner.note(played(balls, 0, other))
    learner.note(dataclasses.replace(played(balls, 1, other), decision=None))
    learner.note(played(balls, 2, learner.controller(GOAL)))
    wait_for_balls(learner, 1)
    learner.reset(start_from_nothing())  # answered after all that was noted before
    play_on(learner, 1)
    assert len(learner.progress.balls) == 1


def test_a_ball_that_flew_when_learning_was_reset_is_not_learned_from(learner) -> None:
    flying = played(drawn(1), 0, learner.controller(GOAL))
    learner.reset(start_from_nothing())
    learner.note(flying)
    play_on(learner, 1)
    assert len(learner.progress.balls) == 1


def test_a_flight_is_played_with_one_policy_and_one_exploration(learner) -> None:
    controller, state = learner.controller(GOAL), drawn(1).states[0]
    first, again, later = (controller.decide(t_s, state[:3], state[3:], stage="post") for t_s in (0.60, 0.62, 2.60))
    np.testing.assert_array_equal(first.action, again.action)
    assert np.abs(first.action - later.action).max() > 0.01
    assert np.abs(later.action).max() <= 1.0


def test_a_ball_that_was_never_decided_on_counts_but_teaches_nothing(learner) -> None:
    controller, state = learner.controller(GOAL), drawn(1).states[0]
    decision = controller.decide(0.6, state[:3], state[3:], stage="pre")
    nowhere = np.full(2, np.nan)
    learner.note(FinishedBall(1_000_000, 0, 5.0, Case.MISSED, nowhere, GOAL, math.nan, decision))
    wait_for_balls(learner, 1)
    assert learner.progress.learned == 0 and learner.progress.returned == 0
    errors, medians = learner.progress.errors_mm()
    assert np.isnan(errors).all() and np.isnan(medians).all()


def test_a_ball_that_cannot_be_learned_from_is_said_and_the_next_one_is(learner, caplog) -> None:
    controller = learner.controller(GOAL)
    broken, whole = (played(drawn(2), number, controller) for number in range(2))
    learner.note(dataclasses.replace(broken, decision=dataclasses.replace(broken.decision, state=np.zeros(3))))
    learner.note(whole)
    wait_for_balls(learner, 2)
    assert learner.progress.learned == 1 and learner.progress.problem and "not learned" in caplog.text


def test_what_was_learned_is_saved_as_a_run_and_gone_on_from(learner, tmp_path: Path) -> None:
    play_on(learner, 30)
    run = tmp_path / "live-1"
    learner.save(run)
    config, saved = read_run(run), load_policy(run)
    assert config.agent == "landing-model" and config.curriculum.episodes == (1, 1, 30, 1, 1, 1, 1)
    for kept, (weight, bias) in zip(saved.layers, learner.policy.layers, strict=True):
        np.testing.assert_array_equal(kept[0], weight)
        np.testing.assert_array_equal(kept[1], bias)
    arrays, about = load_checkpoint(seed_files(run, 0).checkpoint)
    assert Training.from_checkpoint(config, 0, arrays, about, ClosedFormBackend(ENVIRONMENT)).finished
    with pytest.raises(ConfigError, match="a run already"):
        learner.save(run)

    assert can_start_from(run)
    learner.reset(start_from_run(run))
    assert median_error_mm(learner.policy) == median_error_mm(saved)
    play_on(learner, 20, seed=8)
    assert learner.progress.start == "live-1" and not any(ball.random for ball in learner.progress.balls)
    assert median_error_mm(learner.policy) < 1.2 * median_error_mm(saved)


def test_only_a_run_of_the_landing_model_can_be_gone_on_from(learner, tmp_path: Path) -> None:
    paper = default_run("ddpg")
    short = dataclasses.replace(paper.curriculum, speeds_mps=(3.0,), episodes=(2,))
    create_run(tmp_path / "paper", dataclasses.replace(paper, curriculum=short, evaluation_balls=2))
    run_training(tmp_path / "paper")
    assert not can_start_from(tmp_path / "paper") and not can_start_from(tmp_path / "none")
    with pytest.raises(ConfigError, match="can go on learning"):
        start_from_run(tmp_path / "paper")
    damaged = dataclasses.replace(start_from_nothing(), name="damaged", arrays={"agent.actor": np.zeros(3)})
    play_on(learner, 1)
    with pytest.raises(ConfigError, match="checkpoint of another run"):
        learner.reset(damaged)
    assert learner.progress.learned == 1  # it goes on


def test_its_thread_ends_and_says_so_to_whoever_asks_later() -> None:
    others = set(threading.enumerate())
    one = OnlineLearner()
    assert one.progress is None and one.policy is None
    with pytest.raises(ConfigError, match="nothing was learned"):
        one.save(Path("nowhere"))
    one.close()
    assert not any(thread.name == "online-learning" for thread in set(threading.enumerate()) - others)
    with pytest.raises(ConfigError, match="has ended"):
        one.reset(start_from_nothing())
