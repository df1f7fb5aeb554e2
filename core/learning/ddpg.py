"""The paper's agent: deep deterministic policy gradient for one-step episodes.

An actor mu(s, g) and a critic Q(s, g, a), two hidden layers each. The critic learns the reward of a stroke, the actor
climbs the critic. Around it (`training.py`): noise on the action, the replay buffer, the ladder of speeds; and in
`reward.py` the reward that shifts from returning the ball to placing it.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core.learning.agent import Losses, Moment
from core.learning.config import RunConfig
from core.learning.environment import draw_goals
from core.learning.networks import Adam, Mlp
from core.learning.normalise import normal_goals, normal_states
from core.learning.policy import Policy
from core.learning.racket_table import racket_table
from core.learning.replay import ReplayBuffer
from core.learning.reward import Weights, rewards_of

Array = NDArray[np.float64]

SEEN = 8
"""Inputs of the actor: state and target. The critic has the action's three besides."""


class DdpgAgent:
    """Actor, critic (or two) and their optimisers."""

    def __init__(self, config: RunConfig, rng: np.random.Generator) -> None:
        self._run = config
        self._config = config.ddpg
        hidden = config.ddpg.hidden
        self._actor = Mlp(SEEN, 3, hidden, rng)
        self._critics = [Mlp(SEEN + 3, 1, hidden, rng) for _ in range(2 if config.ddpg.twin_critics else 1)]
        self._actor_adam = Adam(self._actor, config.ddpg.actor_rate)
        self._critic_adams = [Adam(critic, config.ddpg.critic_rate) for critic in self._critics]
        # Only the bootstrapped target looks at them; they start as copies and follow slowly.
        self._slow_actor = Mlp(SEEN, 3, hidden, rng)
        self._slow_critics = [Mlp(SEEN + 3, 1, hidden, rng) for _ in self._critics]
        self._follow(1.0)

    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """mu(s, g), (N, 3)."""
        x = np.concatenate([normal_states(states), normal_goals(goals_m)], axis=1)
        return torch.tanh(self._actor.forward(torch.tensor(x))).numpy().astype(np.float64)

    def learn(self, buffer: ReplayBuffer, moment: Moment, rng: np.random.Generator) -> Losses:
        """Two (by default) rounds of critic and actor on a batch from the buffer."""
        losses = Losses(math.nan, math.nan)
        if len(buffer) < self._config.first_update:
            return losses
        for _ in range(self._config.updates_per_episode):
            seen, actions, targets = self._batch(buffer, moment.weights, rng)
            critic_loss = self._improve_critics(seen, actions, targets)
            losses = Losses(critic_loss, self._improve_actor(seen))
            if self._config.target == "bootstrap":
                self._follow(self._config.tau)
        return losses

    def _batch(self, buffer: ReplayBuffer, weights: Weights, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """What was seen (B, 8), done (B, 3), and what Q is to become (B, 1)."""
        rows = buffer.sample(self._config.batch, rng)
        states = normal_states(buffer.column("state")[rows])
        goals = buffer.column("goal")[rows]
        actions = buffer.column("action")[rows]
        rewards = buffer.column("reward")[rows]
        if self._config.target == "bootstrap":
            rewards = rewards + self._config.discount * self._next_values(buffer.column("next_state")[rows], goals)
        if self._config.relabels:
            states, goals, actions, rewards = self._relabel(
                buffer, rows, (states, goals, actions, rewards), weights, rng
            )
        seen = np.concatenate([states, normal_goals(goals)], axis=1)
        # Copied, for aligned memory: matrix kernels may round differently with the alignment.
        return torch.tensor(seen), torch.tensor(actions), torch.tensor(rewards)

    def _improve_critics(self, seen: Tensor, actions: Tensor, targets: Tensor) -> float:
        """One step down (Q(s, g, a) - y)^2."""
        x = torch.cat([seen, actions], 1)
        loss = 0.0
        for critic, adam in zip(self._critics, self._critic_adams, strict=True):
            error = critic.forward(x) - targets
            critic.backward(error * (2 / len(error)))
            adam.step()
            loss = float(torch.dot(error[:, 0], error[:, 0])) / len(error)
        return loss

    def _improve_actor(self, seen: Tensor) -> float:
        """One step up Q(s, g, mu(s, g)); of two critics the lower counts for each ball."""
        actions = torch.tanh(self._actor.forward(seen))
        x = torch.cat([seen, actions], 1)
        values = [critic.forward(x) for critic in self._critics]
        lowest = values[0] if len(values) == 1 else torch.minimum(*values)
        slope = torch.zeros_like(actions)
        for critic, value in zip(self._critics, values, strict=True):
            share = (value <= lowest).float() * (-1 / len(seen))
            slope += critic.backward(share, parameters=False, inputs=True)[:, SEEN:]
        self._actor.backward(slope * (1 - actions * actions))
        self._actor_adam.step()
        return -float(lowest.mean())

    def _next_values(self, next_states: NDArray[np.float32], goals: NDArray[np.float32]) -> NDArray[np.float32]:
        """Q'(s', g, mu'(s', g)) of the target networks: the paper's equation, although the episode is over."""
        seen = torch.tensor(np.concatenate([normal_states(next_states), normal_goals(goals)], axis=1))
        x = torch.cat([seen, torch.tanh(self._slow_actor.forward(seen))], 1)
        values = [critic.forward(x) for critic in self._slow_critics]
        return (values[0] if len(values) == 1 else torch.minimum(*values)).numpy()

    def _follow(self, share: float) -> None:
        """Move the target networks by this share of the way to the learning ones."""
        slow = [self._slow_actor, *self._slow_critics]
        for network, leader in zip(slow, [self._actor, *self._critics], strict=True):
            network.parameters.lerp_(leader.parameters, share)

    def _relabel(
        self,
        buffer: ReplayBuffer,
        rows: NDArray[np.intp],
        batch: tuple[NDArray[np.floating], ...],
        weights: Weights,
        rng: np.random.Generator,
    ) -> tuple[NDArray[np.float32], ...]:
        """The batch and copies of it with random targets: what the stroke would have been worth for them."""
        copies = 1 + self._config.relabels
        states, goals, actions, rewards = (np.tile(part, (copies, 1)).astype(np.float32) for part in batch)
        again = np.tile(rows, self._config.relabels)
        extra = slice(len(rows), None)
        goals[extra] = draw_goals(len(again), self._run.environment.goal, rng)
        rewards[extra, 0] = rewards_of(
            buffer.column("case")[again, 0].astype(np.int8),
            buffer.column("next_state")[again, :2].astype(np.float64),
            buffer.column("net_z")[again, 0].astype(np.float64),
            goals[extra].astype(np.float64),
            weights,
            self._run.reward,
        )
        return states, goals, actions, rewards

    def policy(self) -> Policy:
        """The actor by itself."""
        incoming, racket = racket_table(self._run)
        return Policy(tuple(self._actor.layers()), "relu", "tanh", False, incoming, racket)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Parameters and moments of every network."""
        arrays: dict[str, NDArray[np.generic]] = {}
        for name, network, adam in self._parts():
            arrays.update(network.arrays(name))
            if adam is not None:
                arrays.update(adam.arrays(name))
        return arrays

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """The opposite."""
        for name, network, adam in self._parts():
            network.restore(arrays, name)
            if adam is not None:
                adam.restore(arrays, name)

    def _parts(self) -> list[tuple[str, Mlp, Adam | None]]:
        parts: list[tuple[str, Mlp, Adam | None]] = [("actor", self._actor, self._actor_adam)]
        parts += [(f"critic_{i}", c, a) for i, (c, a) in enumerate(zip(self._critics, self._critic_adams, strict=True))]
        parts += [("slow_actor", self._slow_actor, None)]
        return parts + [(f"slow_critic_{i}", c, None) for i, c in enumerate(self._slow_critics)]
