"""Beyond the paper: an agent whose critic is a model of the stroke, so that every ball teaches every target.

The critic predicts from state, racket speed and action where the ball lands and how high it crosses the net: three
numbers to learn from each ball instead of one reward, and none of them depends on the target. The actor is then trained
through the critic on freely drawn targets: short distance from the predicted landing to the target, over the net by a
margin. (The idea of predicting the reward's parameters: Tebbe et al. 2021.)

A real robot does not see where a netted ball would have landed. Labels that did not happen before the ball's first
contact are masked, unless `privileged` asks for them.
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
from core.learning.landing_heads import Balls, FlightHead, FreeHead, Head, ImpactHead
from core.learning.networks import Adam, Mlp
from core.learning.normalise import LANDING_SCALE, normal_goals, normal_racket_speeds, normal_states
from core.learning.policy import Policy
from core.learning.racket_table import racket_table
from core.learning.replay import ReplayBuffer
from core.simulation.physics.episode import Case
from core.table import BALL_RADIUS_M, NET_HEIGHT_M

Array = NDArray[np.float64]

SITUATION = 7
"""State and racket speed."""
SOFT_M = 0.01
"""Landing errors far below this pull the actor less and less, so that it comes to rest."""


class LandingModelAgent:
    """Actor and landing model with their optimisers."""

    def __init__(self, config: RunConfig, rng: np.random.Generator) -> None:
        self._run = config
        self._config = config.landing_model
        hidden = config.landing_model.hidden
        self._actor = Mlp(SITUATION + 2, 3, hidden, rng)
        self._head = make_head(config)
        self._model = Mlp(SITUATION + 3, self._head.outputs, hidden, rng)
        self._actor_adam = Adam(self._actor, config.landing_model.actor_rate)
        self._model_adam = Adam(self._model, config.landing_model.critic_rate)
        self._scale = torch.tensor(LANDING_SCALE, dtype=torch.float32)
        self._importance = torch.tensor([1.0, 1.0, config.landing_model.net_loss])

    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """mu(s, v_racket, g), (N, 3)."""
        x = np.concatenate(
            [normal_states(states), normal_racket_speeds(racket_speeds_mps)[:, None], normal_goals(goals_m)], axis=1
        )
        return torch.tanh(self._actor.forward(torch.tensor(x))).numpy().astype(np.float64)

    def learn(self, buffer: ReplayBuffer, moment: Moment, rng: np.random.Generator) -> Losses:
        """Many rounds of model and actor early in a stage, fewer later."""
        losses = Losses(math.nan, math.nan)
        if len(buffer) < self._config.first_update:
            return losses
        rate_share = self._config.final_rate**moment.share
        for _ in range(self._updates(moment.episode)):
            rows = buffer.sample(self._config.batch, rng)
            states = normal_states(buffer.column("state")[rows])
            speeds = normal_racket_speeds(buffer.column("racket_speed")[rows])
            situation = torch.tensor(np.concatenate([states, speeds], axis=1))
            played = Balls(*(torch.tensor(buffer.column(name)[rows]) for name in ("state", "racket_speed", "action")))
            model_loss = self._improve_model(situation, played, buffer, rows, rate_share)
            goals = draw_goals(len(rows), self._run.environment.goal, rng)
            losses = Losses(model_loss, self._improve_actor(situation, played, goals, rate_share))
        return losses

    def _updates(self, episode: int) -> int:
        config = self._config
        if episode < config.full_episodes:
            return config.updates_per_episode
        return max(config.fewest_updates, config.updates_per_episode * config.full_episodes // (episode + 1))

    def _improve_model(
        self, situation: Tensor, played: Balls, buffer: ReplayBuffer, rows: NDArray[np.intp], rate_share: float
    ) -> float:
        """One step down the Huber loss of landing point and height at the net, where they are known."""
        landing = np.concatenate([buffer.column("next_state")[rows, :2], buffer.column("net_z")[rows]], axis=1)
        known = buffer.column("known")[rows]
        if self._config.privileged:
            known = np.repeat(buffer.column("case")[rows] != Case.MISSED, 2, axis=1)
        labels = torch.tensor(landing)
        mask = torch.tensor(known[:, [0, 0, 1]]) * ~torch.isnan(labels) * self._importance
        outputs = self._model.forward(torch.cat([situation, played.actions], 1))
        error = (self._head.decode(outputs, played) - torch.nan_to_num(labels)) / self._scale
        slope = error.clamp(-1, 1) * mask
        self._model.backward(self._head.pull(slope / (self._scale * len(rows)))[0])
        self._model_adam.step(rate_share=rate_share)
        return float((slope * error).sum()) / len(rows)

    def _improve_actor(self, situation: Tensor, played: Balls, goals_m: Array, rate_share: float) -> float:
        """One step towards strokes whose predicted landing is the target, and which clear the net."""
        goals = torch.tensor(goals_m, dtype=torch.float32)
        actions = torch.tanh(self._actor.forward(torch.cat([situation, torch.tensor(normal_goals(goals_m))], 1)))
        wanted = Balls(played.states, played.racket_mps, actions)
        predicted = self._head.decode(self._model.forward(torch.cat([situation, actions], 1)), wanted)
        off = predicted[:, :2] - goals
        distance = (off.square().sum(1, keepdim=True) + SOFT_M**2).sqrt_()
        missing = (NET_HEIGHT_M + BALL_RADIUS_M + self._config.net_margin_m) - predicted[:, 2:]
        slope = torch.cat([off / distance, -self._config.net_weight * (missing > 0).float()], 1)
        of_outputs, of_actions = self._head.pull(slope / len(goals))
        toward = self._model.backward(of_outputs, parameters=False, inputs=True)[:, SITUATION:]
        if of_actions is not None:
            toward = toward + of_actions
        self._actor.backward(toward * (1 - actions * actions))
        self._actor_adam.step(rate_share=rate_share)
        return float(distance.mean() + self._config.net_weight * missing.relu().mean())

    def policy(self) -> Policy:
        """The actor by itself."""
        incoming, racket = racket_table(self._run)
        return Policy(tuple(self._actor.layers()), "relu", "tanh", True, incoming, racket)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Parameters and moments of both networks."""
        return {
            **self._actor.arrays("actor"),
            **self._model.arrays("model"),
            **self._actor_adam.arrays("actor"),
            **self._model_adam.arrays("model"),
        }

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """The opposite."""
        self._actor.restore(arrays, "actor")
        self._model.restore(arrays, "model")
        self._actor_adam.restore(arrays, "actor")
        self._model_adam.restore(arrays, "model")


def make_head(config: RunConfig) -> Head:
    """The head that the run asks for."""
    if config.landing_model.head == "impact":
        return ImpactHead(config.environment.task.stroke)
    return FlightHead() if config.landing_model.head == "flight" else FreeHead()
