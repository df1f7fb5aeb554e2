"""The paper's agent: deep deterministic policy gradient (DDPG) with an actor mu(s, g) and a critic Q(s, g, a).

for each episode of a stage:                                                       training.py
    a serve gives the state s, a goal g is drawn                                   environment.py
    a = clip(mu(s, g) + N(0, eta), -1, 1)
    play it: the landing state s', and r, the time-weighted reward of its case     reward.py
    store (s, g, a, r, s')                                                         replay.py
    repeat updates_per_episode times:                                              DdpgAgent.learn
        sample a batch of (s, g, a, r, s')
        y = r + discount (1 - done) Q'(s', g, mu'(s', g))
        critic: one step of Adam down the mean of (Q(s, g, a) - y)^2
        actor: one step of Adam up the mean of Q(s, g, mu(s, g))
        (mu', Q') <- tau (mu, Q) + (1 - tau) (mu', Q')
before the next stage, at a higher speed: keep the transitions with r >= delta     replay.py
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from core.learning.agents.agent import Losses, StageProgress
from core.learning.agents.networks import (
    Arrays,
    adam,
    descend,
    layers_of,
    mlp,
    network_to_arrays,
    restore_network,
    soft_update,
)
from core.learning.agents.policy import Policy
from core.learning.agents.replay import Floats, ReplayBuffer
from core.learning.config import RunConfig
from core.learning.task.environment import draw_goals, racket_table
from core.learning.task.normalise import STATE_SIZES, normal_observations
from core.learning.task.reward import Weights, rewards_of

Array = NDArray[np.float64]

GOAL_SIZE, ACTION_SIZE = 2, 3
EDGE = 2.0
"""Before tanh, where `edge_penalty` begins: 0.96 of the action range. Farther out tanh is so flat that the critic's
slope no longer brings an action back."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Transitions to learn from; observations hold the state and the goal."""

    observations: Tensor
    """(B, 8), of states with spin (B, 14)."""
    actions: Tensor
    """(B, 3)."""
    rewards: Tensor
    """(B, 1)."""
    next_observations: Tensor
    """The landing state with the same goal."""


class DdpgAgent:
    """Actor and critic (or two of them), their target networks and their optimisers."""

    def __init__(self, config: RunConfig, rng: np.random.Generator) -> None:
        self._run = config
        self._config = ddpg = config.ddpg
        critics = 2 if ddpg.twin_critics else 1
        size = STATE_SIZES[config.environment.state] + GOAL_SIZE
        self._actor_body = mlp(size, ACTION_SIZE, ddpg.hidden, rng)
        self.actor = nn.Sequential(*self._actor_body, nn.Tanh())
        self.critics = nn.ModuleList(mlp(size + ACTION_SIZE, 1, ddpg.hidden, rng) for _ in range(critics))
        self.target_actor = copy.deepcopy(self.actor)
        self.target_critics = copy.deepcopy(self.critics)
        self._actor_optimizer = adam(self.actor, ddpg.actor_rate)
        self._critic_optimizer = adam(self.critics, ddpg.critic_rate)

    @torch.inference_mode()
    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """mu(s, g), (N, 3)."""
        return self.actor(torch.tensor(normal_observations(states, goals_m))).numpy().astype(np.float64)

    def learn(self, buffer: ReplayBuffer, progress: StageProgress, rng: np.random.Generator) -> Losses:
        """Four (by default) updates of critic, actor and target networks, each with a batch from the buffer."""
        losses = Losses(math.nan, math.nan)
        if len(buffer) < self._config.first_update:
            return losses
        rate_share = self._config.final_rate**progress.share
        self._actor_optimizer.param_groups[0]["lr"] = self._config.actor_rate * rate_share
        self._critic_optimizer.param_groups[0]["lr"] = self._config.critic_rate * rate_share
        for _ in range(self._config.updates_per_episode):
            batch = self._sample(buffer, progress.weights, rng)
            losses = Losses(self._update_critics(batch), self._update_actor(batch))
            if self._config.target == "bootstrap":  # used here only
                soft_update(self.target_actor, self.actor, self._config.tau)
                soft_update(self.target_critics, self.critics, self._config.tau)
        return losses

    @torch.no_grad()
    def td_target(self, batch: Batch) -> Tensor:
        """y = r + discount (1 - done) Q'(s', g, mu'(s', g)), (B, 1).

        An episode is one action, so it is done after it and y = r. With `bootstrap` it never is: that is the paper's
        equation as written.
        """
        if self._config.target == "terminal":
            return batch.rewards
        next_actions = self.target_actor(batch.next_observations)
        next_values = lowest_value(self.target_critics, batch.next_observations, next_actions)
        return batch.rewards + self._config.discount * next_values

    def _update_critics(self, batch: Batch) -> float:
        x = torch.cat([batch.observations, batch.actions], 1)
        target = self.td_target(batch)
        losses = [nn.functional.mse_loss(critic(x), target) for critic in self.critics]
        return descend(torch.stack(losses).sum(), self._critic_optimizer) / len(losses)

    def _update_actor(self, batch: Batch) -> float:
        drive = self._actor_body(batch.observations)
        loss = -lowest_value(self.critics, batch.observations, torch.tanh(drive)).mean()
        if self._config.edge_penalty:
            beyond = (drive.abs() - EDGE).clamp(min=0)
            loss = loss + self._config.edge_penalty * beyond.square().sum(1).mean()
        return descend(loss, self._actor_optimizer)

    def _sample(self, buffer: ReplayBuffer, weights: Weights, rng: np.random.Generator) -> Batch:
        """Uniformly drawn transitions, and with `relabels` copies of them with new goals and the rewards for these."""
        rows = buffer.sample(self._config.batch, rng)
        goals, rewards = buffer.column("goal")[rows], buffer.column("reward")[rows]
        if self._config.rewards == "current":
            rewards = self._rewards_for(buffer, rows, goals, weights)
        if self._config.relabels:
            again = np.tile(rows, self._config.relabels)
            new_goals = draw_goals(len(again), self._run.environment.goal, rng).astype(np.float32)
            new_rewards = self._rewards_for(buffer, again, new_goals, weights)
            rows, goals = np.concatenate([rows, again]), np.concatenate([goals, new_goals])
            rewards = np.concatenate([rewards, new_rewards])
        return Batch(
            torch.tensor(normal_observations(buffer.column("state")[rows], goals)),
            torch.tensor(buffer.column("action")[rows]),
            torch.tensor(rewards),
            torch.tensor(normal_observations(buffer.column("next_state")[rows], goals)),
        )

    def _rewards_for(self, buffer: ReplayBuffer, rows: NDArray[np.intp], goals: Floats, weights: Weights) -> Floats:
        """Rewards (B, 1) of the strokes in rows (B,) for goals (B, 2), by weights other than those of their time."""
        rewards = rewards_of(
            buffer.column("case")[rows, 0].astype(np.int8),
            buffer.column("next_state")[rows, :2].astype(np.float64),
            buffer.column("net_z")[rows, 0].astype(np.float64),
            goals.astype(np.float64),
            weights,
            self._run.reward,
        )
        return rewards[:, None].astype(np.float32)

    def policy(self) -> Policy:
        """The actor by itself."""
        incoming, racket = racket_table(self._run)
        state = self._run.environment.state
        return Policy(layers_of(self.actor), "relu", "tanh", False, incoming, racket, state)

    def to_arrays(self) -> Arrays:
        """Parameters and moments of every network."""
        arrays: Arrays = {}
        for name, network, optimizer in self._networks():
            arrays |= network_to_arrays(name, network, optimizer)
        return arrays

    def restore(self, arrays: Arrays) -> None:
        """Load what `to_arrays` gave; earlier checkpoints call the target networks slow."""
        arrays = {name.replace("slow_", "target_"): array for name, array in arrays.items()}
        for name, network, optimizer in self._networks():
            restore_network(arrays, name, network, optimizer)

    def _networks(self) -> list[tuple[str, nn.Module, torch.optim.Adam | None]]:
        return [
            ("actor", self.actor, self._actor_optimizer),
            *((f"critic_{i}", critic, self._critic_optimizer) for i, critic in enumerate(self.critics)),
            ("target_actor", self.target_actor, None),
            *((f"target_critic_{i}", critic, None) for i, critic in enumerate(self.target_critics)),
        ]


def lowest_value(critics: nn.ModuleList, observations: Tensor, actions: Tensor) -> Tensor:
    """Q(s, g, a), (B, 1); of two critics the lower for each ball."""
    x = torch.cat([observations, actions], 1)
    return torch.stack([critic(x) for critic in critics]).amin(0)
