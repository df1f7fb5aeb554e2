"""The paper's agent by value: its target by hand, its updates against a few lines of numpy."""

import copy

import numpy as np
import pytest
import torch

from core.learning.agents.agent import StageProgress
from core.learning.agents.ddpg import Batch, DdpgAgent
from core.learning.agents.networks import layers_of
from core.learning.agents.replay import COLUMNS, ReplayBuffer
from core.learning.config import DdpgConfig, RunConfig
from core.learning.task.normalise import normal_observations
from core.learning.task.reward import Weights
from core.physics.episode import Case

pytestmark = pytest.mark.numeric
PROGRESS = StageProgress(0, 0.0, Weights(1.0, 0.0))
TANH_03 = 0.2913126


def agent_of(**changes: object) -> DdpgAgent:
    config = DdpgConfig(**{"hidden": 8, "batch": 16, "first_update": 1, "updates_per_episode": 1} | changes)
    return DdpgAgent(RunConfig(ddpg=config), np.random.default_rng(0))


def make_by_hand(critic: torch.nn.Sequential, slope: float, offset: float) -> None:
    """Q = slope * max(a_1 + s_1 + 1, 0) + offset, with a_1 the first of the action and s_1 of the observation."""
    with torch.no_grad():
        for parameter in critic.parameters():
            parameter.zero_()
        critic[0].weight[0, [0, 8]] = 1.0
        critic[0].bias[0] = 1.0
        critic[2].weight[0, 0] = 1.0
        critic[4].weight[0, 0] = slope
        critic[4].bias[0] = offset


def by_hand(twin: bool, target: str) -> DdpgAgent:
    agent = agent_of(twin_critics=twin, target=target, discount=0.9)
    with torch.no_grad():
        for parameter in agent.target_actor.parameters():
            parameter.zero_()
        agent.target_actor[4].bias[0] = 0.3  # mu'_1 = tanh 0.3 whatever is seen
    make_by_hand(agent.target_critics[0], 2.0, 0.5)
    if twin:
        make_by_hand(agent.target_critics[1], -1.0, 4.0)
    return agent


BATCH = Batch(
    torch.zeros(2, 8),
    torch.zeros(2, 3),
    torch.tensor([[1.5], [-1.0]]),
    torch.tensor([[0.0] * 8, [0.75] + [0.0] * 7]),
)


def test_the_target_of_a_finished_episode_is_its_reward() -> None:
    torch.testing.assert_close(by_hand(False, "terminal").td_target(BATCH), torch.tensor([[1.5], [-1.0]]))


def test_the_bootstrapped_target_adds_the_discounted_value_of_what_follows() -> None:
    # Q' = 2 (tanh 0.3 + 0 + 1) + 0.5 = 3.0826252 and 2 (tanh 0.3 + 0.75 + 1) + 0.5 = 4.5826252
    expected = torch.tensor([[1.5 + 0.9 * 3.0826252], [-1.0 + 0.9 * 4.5826252]])
    torch.testing.assert_close(by_hand(False, "bootstrap").td_target(BATCH), expected)
    torch.testing.assert_close(expected, torch.tensor([[4.2743627], [3.1243627]]))


def test_of_twin_critics_the_lower_one_is_the_target() -> None:
    # The second: Q' = 4 - (tanh 0.3 + 1) = 2.7086874 and 4 - (tanh 0.3 + 1.75) = 1.9586874, both lower.
    expected = torch.tensor([[1.5 + 0.9 * 2.7086874], [-1.0 + 0.9 * 1.9586874]])
    torch.testing.assert_close(by_hand(True, "bootstrap").td_target(BATCH), expected)
    assert pytest.approx(4 - (TANH_03 + 1), abs=1e-6) == 2.7086874


def filled_buffer() -> ReplayBuffer:
    rng = np.random.default_rng(1)
    buffer = ReplayBuffer(40)
    for _ in range(40):
        row = {name: rng.normal(size=width) for name, width in COLUMNS.items()}
        state = np.array([-1.42, 0.0, 0.24, -5.0, 0.0, 0.9])
        states = {name: state + rng.normal(0, 0.1, 6) for name in ("state", "next_state")}
        buffer.add(row | states | {"action": rng.uniform(-1, 1, 3)})
    return buffer


class NumpyAdam:
    """Kingma and Ba (2015), algorithm 1."""

    def __init__(self, rate: float) -> None:
        self.rate, self.t = rate, 0
        self.m: list[np.ndarray] = []
        self.v: list[np.ndarray] = []

    def step(self, parameters: list[np.ndarray], gradients: list[np.ndarray]) -> None:
        self.t += 1
        self.m = self.m or [np.zeros_like(g) for g in gradients]
        self.v = self.v or [np.zeros_like(g) for g in gradients]
        for p, g, m, v in zip(parameters, gradients, self.m, self.v, strict=True):
            m += 0.1 * (g - m)
            v += 0.001 * (g * g - v)
            p -= self.rate * (m / (1 - 0.9**self.t)) / (np.sqrt(v / (1 - 0.999**self.t)) + 1e-8)


def forward(parameters: list[np.ndarray], x: np.ndarray) -> list[np.ndarray]:
    """The inputs of each layer, and the output."""
    found = [x]
    for i, (w, b) in enumerate(pairs(parameters)):
        y = found[-1] @ w + b
        found.append(np.maximum(y, 0) if i < 2 else y)
    return found


def pairs(parameters: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    return list(zip(parameters[::2], parameters[1::2], strict=True))


def backward(
    parameters: list[np.ndarray], found: list[np.ndarray], slope: np.ndarray
) -> tuple[list[np.ndarray], np.ndarray]:
    """Gradients of the parameters and of the input, given the one of the output."""
    gradients: list[np.ndarray] = []
    for i, (w, _) in reversed(list(enumerate(pairs(parameters)))):
        gradients = [found[i].T @ slope, slope.sum(0), *gradients]
        slope = slope @ w.T
        if i:
            slope = slope * (found[i] > 0)
    return gradients, slope


def in_double(network: torch.nn.Sequential) -> list[np.ndarray]:
    return [part.astype(np.float64) for layer in layers_of(network) for part in layer]


@pytest.mark.parametrize("target", ["terminal", "bootstrap"])
def test_updates_are_those_of_a_few_lines_of_numpy(target: str) -> None:
    agent = agent_of(target=target, actor_rate=1e-3, critic_rate=3e-3, discount=0.9, tau=0.1)
    actor, critic = in_double(agent.actor), in_double(agent.critics[0])
    slow_actor, slow_critic = copy.deepcopy(actor), copy.deepcopy(critic)
    actor_adam, critic_adam = NumpyAdam(1e-3), NumpyAdam(3e-3)
    buffer, rng, same = filled_buffer(), np.random.default_rng(2), np.random.default_rng(2)
    for _ in range(4):
        losses = agent.learn(buffer, PROGRESS, rng)
        rows = same.integers(0, 40, 16)
        state, following, goal, a, y = (
            buffer.column(name)[rows].astype(np.float64) for name in ("state", "next_state", "goal", "action", "reward")
        )
        seen, later = normal_observations(state, goal), normal_observations(following, goal)
        if target == "bootstrap":
            to_come = np.tanh(forward(slow_actor, later)[-1])
            y = y + 0.9 * forward(slow_critic, np.hstack([later, to_come]))[-1]
        found = forward(critic, np.hstack([seen, a]))
        error = found[-1] - y
        assert losses.critic == pytest.approx((error**2).mean(), rel=1e-4)
        critic_adam.step(critic, backward(critic, found, 2 * error / 16)[0])
        acting = forward(actor, seen)
        mu = np.tanh(acting[-1])
        found = forward(critic, np.hstack([seen, mu]))
        assert losses.actor == pytest.approx(-found[-1].mean(), rel=1e-3, abs=1e-5)
        of_action = backward(critic, found, np.full((16, 1), -1 / 16))[1][:, 8:]
        actor_adam.step(actor, backward(actor, acting, of_action * (1 - mu**2))[0])
        for slow, fast in ((slow_actor, actor), (slow_critic, critic)):
            for p, q in zip(slow, fast, strict=True):
                p += 0.1 * (q - p)
    compared = [(agent.actor, actor), (agent.critics[0], critic)]
    if target == "bootstrap":
        compared += [(agent.target_actor, slow_actor), (agent.target_critics[0], slow_critic)]
    for network, expected in compared:
        for ours, theirs in zip(in_double(network), expected, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=2e-6)


def test_a_penalty_brings_the_actor_back_from_the_edge_where_the_critic_cannot() -> None:
    def far_out(penalty: float) -> tuple[DdpgAgent, float]:
        agent = agent_of(edge_penalty=penalty, actor_rate=1e-2)
        with torch.no_grad():
            for parameter in agent.actor.parameters():
                parameter.zero_()
            agent.actor[4].bias[:] = torch.tensor([8.0, -3.0, 1.0])
        return agent, agent.learn(filled_buffer(), PROGRESS, np.random.default_rng(0)).actor

    (bare, alone), (held, both) = far_out(0.0), far_out(0.5)
    assert both - alone == pytest.approx(0.5 * (6.0**2 + 1.0**2), abs=1e-4)
    before, moved = torch.tensor([8.0, -3.0, 1.0]), held.actor[4].bias
    # Adam's first step is the rate, whatever the slope: both angles that are too far out come in.
    torch.testing.assert_close((moved - before)[:2], torch.tensor([-0.01, 0.01]), atol=1e-5, rtol=0)
    torch.testing.assert_close(moved[2], bare.actor[4].bias[2])


def test_nothing_is_learned_before_the_buffer_holds_enough() -> None:
    agent = agent_of(first_update=41)
    before = agent.to_arrays()
    losses = agent.learn(filled_buffer(), PROGRESS, np.random.default_rng(0))
    assert np.isnan(losses.critic) and np.isnan(losses.actor)
    for name, array in agent.to_arrays().items():
        np.testing.assert_array_equal(array, before[name])


def test_rewards_are_those_stored_or_those_that_the_present_weights_give() -> None:
    buffer = ReplayBuffer(1)
    row = {name: np.zeros(width) for name, width in COLUMNS.items()}
    # Returned 0.25 m from its target, in an episode when only returning counted.
    landed = {"next_state": np.array([0.7, 0.1, 0, 0, 0, 0]), "goal": np.array([0.7, 0.35])}
    buffer.add(row | landed | {"case": np.array([float(Case.RETURNED)]), "reward": np.array([1.0])})
    now, rng = Weights(0.5, 0.5), np.random.default_rng(0)
    assert agent_of()._sample(buffer, now, rng).rewards.unique().tolist() == [1.0]
    # 0.5 l_base + 0.5 (l_base + l_scale (1 - 0.25)) = 0.5 + 0.5 (1 + 3 * 0.75)
    again = agent_of(rewards="current")._sample(buffer, now, rng).rewards.unique()
    torch.testing.assert_close(again, torch.tensor([2.125]))


@pytest.mark.parametrize(("final", "left"), [(1.0, 1.0), (0.04, 0.2)])
def test_both_rates_fall_exponentially_to_their_final_share(final: float, left: float) -> None:
    agent = agent_of(final_rate=final, actor_rate=1e-3, critic_rate=2e-3)
    halfway = StageProgress(50, 0.5, Weights(0.0, 1.0))
    agent.learn(filled_buffer(), halfway, np.random.default_rng(0))
    rates = [one.param_groups[0]["lr"] for one in (agent._actor_optimizer, agent._critic_optimizer)]
    assert rates == pytest.approx([1e-3 * left, 2e-3 * left])
