"""The landing model by value: what each ball teaches and how much, both losses in numpy, and how often it learns."""

import dataclasses

import numpy as np
import pytest
import torch

from core.learning.agents.agent import StageProgress
from core.learning.agents.landing_model import Balls, FlightHead, FreeHead, ImpactHead, LandingModelAgent, make_head
from core.learning.agents.networks import layers_of
from core.learning.agents.replay import COLUMNS, ReplayBuffer
from core.learning.config import LandingModelConfig, RunConfig
from core.learning.task.reward import Weights
from core.physics.episode import Case

pytestmark = pytest.mark.numeric
SCALE = np.array([0.8, 0.5, 0.3])
CENTRE = np.array([0.7, 0.0, 0.3])


def agent_of(**changes: object) -> LandingModelAgent:
    config = LandingModelConfig(**{"hidden": 8, "batch": 16, "first_update": 1, "updates_per_episode": 1} | changes)
    return LandingModelAgent(RunConfig(agent="landing-model", landing_model=config), np.random.default_rng(0))


def filled(rows: list[dict[str, object]]) -> ReplayBuffer:
    buffer = ReplayBuffer(len(rows))
    for row in rows:
        empty = {name: np.zeros(width) for name, width in COLUMNS.items()}
        buffer.add(empty | {name: np.asarray(value, np.float64) for name, value in row.items()})
    return buffer


def test_a_ball_teaches_what_was_seen_of_it_and_the_net_counts_less() -> None:
    buffer = filled(
        [
            {"next_state": [0.8, 0.1, 9, 9, 9, 9], "net_z": [0.4], "known": [1, 1], "case": [Case.RETURNED]},
            {"next_state": [0.3, 0.2, 9, 9, 9, 9], "net_z": [0.1], "known": [0, 1], "case": [Case.NET]},
            {"next_state": [-0.5, 0.3, 9, 9, 9, 9], "net_z": [np.nan], "known": [1, 1], "case": [Case.OWN_HALF]},
            {"next_state": [-1.4, 0.0, 9, 9, 9, 9], "net_z": [np.nan], "known": [0, 0], "case": [Case.MISSED]},
        ]
    )
    rows = np.array([0, 1, 2, 3, 0])
    labels, weights = agent_of(net_loss=0.3)._labels(buffer, rows)
    expected = [[0.8, 0.1, 0.4], [0.3, 0.2, 0.1], [-0.5, 0.3, 0.0], [-1.4, 0.0, 0.0], [0.8, 0.1, 0.4]]
    np.testing.assert_allclose(labels.numpy(), expected, atol=1e-6)
    counted = [[1, 1, 0.3], [0, 0, 0.3], [1, 1, 0], [0, 0, 0], [1, 1, 0.3]]
    np.testing.assert_allclose(weights.numpy(), counted, atol=1e-6)
    _, weights = agent_of(net_loss=0.5, privileged=True)._labels(buffer, rows)
    np.testing.assert_allclose(weights.numpy(), [[1, 1, 0.5], [1, 1, 0.5], [1, 1, 0], [0, 0, 0], [1, 1, 0.5]])


def played(count: int) -> tuple[torch.Tensor, Balls]:
    """Situations (N, 7) as the networks see them, and the balls; the free head looks at neither ball nor racket."""
    rng = np.random.default_rng(1)
    situations = torch.tensor(rng.normal(size=(count, 7)), dtype=torch.float32)
    parts = np.zeros((count, 6)), np.zeros((count, 1)), rng.uniform(-1, 1, (count, 3))
    return situations, Balls(*(torch.tensor(part, dtype=torch.float32) for part in parts))


def answer(network: torch.nn.Sequential, x: np.ndarray) -> np.ndarray:
    """A perceptron with ReLU in numpy."""
    layers = layers_of(network)
    for weight, bias in layers[:-1]:
        x = np.maximum(x @ weight + bias, 0)
    return x @ layers[-1][0] + layers[-1][1]


def test_the_models_loss_is_hubers_of_the_scaled_errors_and_falls() -> None:
    agent = agent_of(critic_rate=0.01)
    situations, balls = played(5)
    labels = np.array([[3.0, 0.1, 0.4], [0.7, 0.1, 0.3], [-2.0, 0.0, 0.2], [0.9, 0.9, 0.3], [0.1, 0.0, 0.0]])
    weights = np.array([[1, 1, 0.3], [0, 0, 0.3], [1, 1, 0], [1, 1, 0.3], [1, 1, 0.3]])
    said = answer(agent._model, np.hstack([situations.numpy(), balls.actions.numpy()])) * SCALE + CENTRE
    off = np.abs(said - labels) / SCALE
    assert (off > 1).any() and (off < 1).any(), "both branches of Huber's"
    expected = (np.where(off < 1, off**2 / 2, off - 0.5) * weights).sum() / 5
    as_tensors = (torch.tensor(array, dtype=torch.float32) for array in (labels, weights))
    first = agent._update_model(situations, balls, *as_tensors)
    assert first == pytest.approx(expected, rel=1e-5)
    again = [torch.tensor(array, dtype=torch.float32) for array in (labels, weights)]
    assert agent._update_model(situations, balls, *again) < first


def test_the_actors_loss_is_the_way_to_the_target_and_what_is_missing_over_the_net() -> None:
    agent = agent_of(net_weight=4.0, net_margin_m=0.02)
    situations, balls = played(40)
    goals = np.random.default_rng(2).uniform([0.45, -0.45], [1.1, 0.45], (40, 2))
    normal = (goals - [0.775, 0.0]) / [0.325, 0.45]
    actions = np.tanh(answer(agent._actor, np.hstack([situations.numpy(), normal])))
    seen = np.hstack([situations.numpy(), actions])
    with torch.no_grad():  # so that about half of the balls clear the net
        agent._model[4].weight.mul_(100.0)
        agent._model[4].bias[2] += float((0.1925 - CENTRE[2]) / SCALE[2] - np.median(answer(agent._model, seen)[:, 2]))
    said = answer(agent._model, seen) * SCALE + CENTRE
    missing = np.maximum(0.1525 + 0.02 + 0.02 - said[:, 2], 0)
    assert (missing > 0).any() and (missing == 0).any()
    expected = (np.sqrt(((said[:, :2] - goals) ** 2).sum(1) + 0.01**2) + 4.0 * missing).mean()
    model = [parameter.clone() for parameter in agent._model.parameters()]
    assert agent._update_actor(situations, balls, goals) == pytest.approx(expected, rel=1e-4)
    for parameter, before in zip(agent._model.parameters(), model, strict=True):
        assert torch.equal(parameter, before), "the critic does not move with the actor"


def test_it_learns_often_at_first_and_then_as_one_over_the_episode() -> None:
    agent = agent_of(updates_per_episode=32, full_episodes=100, fewest_updates=4)
    updates = [agent._updates(episode) for episode in (0, 99, 100, 199, 399, 799, 800, 5000)]
    assert updates == [32, 32, 31, 16, 8, 4, 4, 4]


def test_both_rates_fall_to_their_last_share_during_a_stage() -> None:
    agent = agent_of(actor_rate=1e-3, critic_rate=4e-3, final_rate=0.01)
    row = {"state": [-1.42, 0, 0.24, -5, 0, 0.9], "next_state": [0.8, 0.1, 0, 0, 0, 0], "net_z": [0.3], "known": [1, 1]}
    buffer = filled([dict(row) for _ in range(20)])
    for share, left in ((0.0, 1.0), (0.5, 0.1), (1.0, 0.01)):
        losses = agent.learn(buffer, StageProgress(0, share, Weights(1, 0)), np.random.default_rng(0))
        assert np.isfinite([losses.critic, losses.actor]).all()
        assert agent._actor_optimizer.param_groups[0]["lr"] == pytest.approx(1e-3 * left)
        assert agent._model_optimizer.param_groups[0]["lr"] == pytest.approx(4e-3 * left)


def test_nothing_is_learned_before_the_buffer_holds_enough() -> None:
    buffer = filled([{"known": [1, 1]}] * 7)
    progress = StageProgress(0, 0.0, Weights(1, 0))
    for first, learns in ((7, True), (8, False)):
        losses = agent_of(first_update=first).learn(buffer, progress, np.random.default_rng(0))
        assert np.isfinite(losses.critic) == np.isfinite(losses.actor) == learns


def test_the_head_is_the_one_that_the_run_asks_for() -> None:
    run = RunConfig(agent="landing-model")
    for name, kind in (("free", FreeHead), ("flight", FlightHead), ("impact", ImpactHead)):
        asked = dataclasses.replace(run, landing_model=LandingModelConfig(head=name))
        head = make_head(asked)
        assert type(head) is kind
        agent = LandingModelAgent(asked, np.random.default_rng(0))
        assert layers_of(agent._model)[-1][1].shape == (head.outputs,)
    with_tilt = dataclasses.replace(run.environment.task.stroke, base_pitch_deg=10.0)
    task = dataclasses.replace(run.environment.task, stroke=with_tilt)
    tilted = dataclasses.replace(
        run,
        environment=dataclasses.replace(run.environment, task=task),
        landing_model=LandingModelConfig(head="impact"),
    )
    level, raised = (
        make_head(config).decode(
            torch.zeros(1, 5), Balls(torch.tensor([[-1.4, 0, 0.3, -5, 0, 0]]), torch.ones(1, 1), torch.zeros(1, 3))
        )
        for config in (dataclasses.replace(run, landing_model=LandingModelConfig(head="impact")), tilted)
    )
    assert raised[0, 2] > level[0, 2], "a face that is tilted up sends the ball higher over the net"
