"""Beyond the paper: an agent whose critic is a model of the stroke, so that every ball teaches every target.

The critic predicts from state, racket speed and action where the ball lands and how high it crosses the net: three
numbers to learn from each ball instead of one reward, and none of them depends on the target. The actor is then trained
through the critic on freely drawn targets: short distance from the predicted landing to the target, over the net by a
margin. (The idea of predicting the reward's parameters: Tebbe et al. 2021.)

A real robot does not see where a netted ball would have landed. Labels that did not happen before the ball's first
contact are masked, unless `privileged` asks for them.

Output heads of the landing model. `free`: the landing and the height at the net themselves. `flight`: the ball's
velocity after the stroke, from which gravity gives both. `impact`: how much of its speed the rubber gives back and how
well it grips, from which the law of reflection gives that velocity: its form is known, its numbers are learned.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Protocol

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
)
from core.learning.agents.policy import Policy
from core.learning.agents.replay import ReplayBuffer
from core.learning.config import CHOSEN_MPS, RunConfig
from core.learning.task.environment import action_size, draw_goals, racket_table
from core.learning.task.normalise import (
    LANDING_CENTRE,
    LANDING_SCALE,
    STATE_SIZES,
    normal_goals,
    normal_observations,
    normal_racket_speeds,
    normal_states,
)
from core.physics.episode import Case
from core.physics.task import StrokeConfig
from core.table import BALL_RADIUS_M, GRAVITY_MPS2, NET_HEIGHT_M

RESTITUTION, GRIP, PUSH_MPS = (0.6, 0.2), (0.3, 0.2), 0.03
"""Centre and scale of the impact head's outputs: a guess to start from, not the simulator's numbers (0.78 and 0.4).
The push is small, so that it is learned last."""
SLOWEST_MPS = 0.3
"""Lower bound of the speeds towards the net and downwards: slower balls do not come near the net."""


@dataclass(frozen=True, slots=True, eq=False)
class Balls:
    """Known states of balls at the racket, and the strokes."""

    states: Tensor
    """(B, 6) position and velocity, or (B, 12) with spin and its uncertainty."""
    racket_mps: Tensor
    """(B, 1) speed of the racket along +x."""
    actions: Tensor
    """(B, 3), or (B, 4) with the racket's speed."""


class Head(Protocol):
    """Outputs of a network to landing x, y and height at the net (m)."""

    @property
    def outputs(self) -> int:
        """Number of outputs."""
        ...

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        """(B, 3) of outputs (B, outputs)."""
        ...


class FreeHead:
    """The outputs are the landing and the height, scaled."""

    outputs = 3

    def __init__(self) -> None:
        self._centre = torch.tensor(LANDING_CENTRE, dtype=torch.float32)
        self._scale = torch.tensor(LANDING_SCALE, dtype=torch.float32)

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        return outputs * self._scale + self._centre


class FlightHead:
    """The outputs are the velocity after the stroke, scaled; landing and height follow from a parabola."""

    outputs = 3

    def __init__(self) -> None:
        self._centre = torch.tensor([3.5, 0.0, 1.5])
        self._scale = torch.tensor([1.2, 0.8, 1.2])

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        return fly_to_landing(outputs * self._scale + self._centre, balls.states)


class ImpactHead:
    """The outputs are restitution, grip, and a push that neither explains (spin, a racket that is not quite where it
    was sent); the velocity after the stroke follows from the face's normal, and the rest from a parabola.
    """

    outputs = 5

    def __init__(self, stroke: StrokeConfig) -> None:
        self._limit = math.radians(stroke.action_limit_deg)
        base = math.radians(stroke.base_pitch_deg)
        self._base = torch.tensor(
            [[math.cos(base), 0, -math.sin(base)], [0, 1, 0], [math.sin(base), 0, math.cos(base)]],
        )

    def decode(self, outputs: Tensor, balls: Balls) -> Tensor:
        normal = normals_of(balls.actions[:, :3] * self._limit) @ self._base.T
        racket = torch.nn.functional.pad(balls.racket_mps, (0, 2))
        arriving = balls.states[:, 3:6] - racket
        towards = (arriving * normal).sum(1, keepdim=True)
        restitution = RESTITUTION[0] + RESTITUTION[1] * outputs[:, :1]
        kept = 1 - GRIP[0] - GRIP[1] * outputs[:, 1:2]
        velocity = racket + kept * arriving - (restitution + kept) * towards * normal + PUSH_MPS * outputs[:, 2:]
        if balls.states.shape[1] > 6:  # the contact point's velocity includes the spin
            spin_there = torch.linalg.cross(balls.states[:, 6:9], normal)
            velocity = velocity + (1 - kept) * BALL_RADIUS_M * spin_there
        return fly_to_landing(velocity, balls.states)


def normals_of(angles_rad: Tensor) -> Tensor:
    """(B, 3) of the face on an upright base: the x axis after turns (B, 3) about x, y and z."""
    s, c = torch.sin(angles_rad), torch.cos(angles_rad)
    forward, side, up = c[:, 1] * c[:, 2], s[:, 2], -s[:, 1] * c[:, 2]
    return torch.stack([forward, c[:, 0] * side - s[:, 0] * up, s[:, 0] * side + c[:, 0] * up], 1)


def fly_to_landing(v: Tensor, states: Tensor) -> Tensor:
    """Landing x, y and height at the net (B, 3) of balls that leave with velocities v (B, 3)."""
    vx, vy, vz = v[:, 0], v[:, 1], v[:, 2]
    drop = states[:, 2] - BALL_RADIUS_M
    # Speed at which the ball comes down to the table's plane; a racket below the plane may not reach it at all.
    down = (vz * vz + 2 * GRAVITY_MPS2 * drop).clamp_min(SLOWEST_MPS**2).sqrt()
    t = (vz + down) / GRAVITY_MPS2
    t_net = -states[:, 0] / vx.clamp_min(SLOWEST_MPS)
    z_net = states[:, 2] + vz * t_net - 0.5 * GRAVITY_MPS2 * t_net * t_net
    return torch.stack([states[:, 0] + vx * t, states[:, 1] + vy * t, z_net], 1)


Array = NDArray[np.float64]

SOFT_M = 0.01
"""Landing errors far below this count less and less, so that the actor converges."""


class LandingModelAgent:
    """Actor and landing model with their optimisers."""

    def __init__(self, config: RunConfig, rng: np.random.Generator) -> None:
        self._run = config
        self._config = ours = config.landing_model
        self._head = make_head(config)
        actions = action_size(config.environment)
        self._chooses_speed = actions == 4
        # A situation is the state, and the racket's speed where that is given.
        situation = STATE_SIZES[config.environment.state] + (0 if self._chooses_speed else 1)
        self._actor = mlp(situation + 2, actions, ours.hidden, rng).append(nn.Tanh())
        self._model = mlp(situation + actions, self._head.outputs, ours.hidden, rng)
        self._actor_optimizer = adam(self._actor, ours.actor_rate)
        self._model_optimizer = adam(self._model, ours.critic_rate)
        self._scale = torch.tensor(LANDING_SCALE, dtype=torch.float32)
        self._importance = torch.tensor([1.0, 1.0, ours.net_loss])

    @torch.inference_mode()
    def act(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """mu(s, v_racket, g), (N, 3), or with the racket's speed mu(s, g), (N, 4)."""
        given = None if self._chooses_speed else racket_speeds_mps
        observations = torch.tensor(normal_observations(states, goals_m, given))
        return self._actor(observations).numpy().astype(np.float64)

    def learn(self, buffer: ReplayBuffer, progress: StageProgress, rng: np.random.Generator) -> Losses:
        """Many updates of model and actor early in a stage, fewer later."""
        losses = Losses(math.nan, math.nan)
        if len(buffer) < self._config.first_update:
            return losses
        rate_share = self._config.final_rate**progress.share
        self._actor_optimizer.param_groups[0]["lr"] = self._config.actor_rate * rate_share
        self._model_optimizer.param_groups[0]["lr"] = self._config.critic_rate * rate_share
        for _ in range(self._updates(progress.episode)):
            rows = buffer.sample(self._config.batch, rng)
            states, speeds = buffer.column("state")[rows], buffer.column("racket_speed")[rows]
            given = [] if self._chooses_speed else [normal_racket_speeds(speeds)]
            situations = torch.tensor(np.concatenate([normal_states(states), *given], axis=1))
            balls = Balls(torch.tensor(states), torch.tensor(speeds), torch.empty(0))
            played = self._strokes(balls, torch.tensor(buffer.column("action")[rows]))
            model_loss = self._update_model(situations, played, *self._labels(buffer, rows))
            goals = draw_goals(len(rows), self._run.environment.goal, rng)
            losses = Losses(model_loss, self._update_actor(situations, played, goals))
        return losses

    def _updates(self, episode: int) -> int:
        config = self._config
        if episode < config.full_episodes:
            return config.updates_per_episode
        return max(config.fewest_updates, config.updates_per_episode * config.full_episodes // (episode + 1))

    def _labels(self, buffer: ReplayBuffer, rows: NDArray[np.intp]) -> tuple[Tensor, Tensor]:
        """Landing point and height at the net (B, 3), and how much each counts: nothing where it is not known."""
        labels = torch.tensor(np.concatenate([buffer.column("next_state")[rows, :2], buffer.column("net_z")[rows]], 1))
        known = buffer.column("known")[rows]
        if self._config.privileged:
            known = np.repeat(buffer.column("case")[rows] != Case.MISSED, 2, axis=1)
        weights = torch.tensor(known[:, [0, 0, 1]]) * ~torch.isnan(labels) * self._importance
        return torch.nan_to_num(labels), weights

    def _update_model(self, situations: Tensor, played: Balls, labels: Tensor, weights: Tensor) -> float:
        """One step down the Huber loss."""
        predicted = self._head.decode(self._model(torch.cat([situations, played.actions], 1)), played)
        losses = nn.functional.huber_loss(predicted / self._scale, labels / self._scale, reduction="none")
        return descend((losses * weights).sum() / len(labels), self._model_optimizer)

    def _strokes(self, balls: Balls, actions: Tensor) -> Balls:
        """Balls with other strokes."""
        if not self._chooses_speed:
            return dataclasses.replace(balls, actions=actions)
        low, high = CHOSEN_MPS
        return dataclasses.replace(balls, actions=actions, racket_mps=low + (high - low) * (actions[:, 3:] + 1) / 2)

    def _update_actor(self, situations: Tensor, played: Balls, goals_m: Array) -> float:
        """One step towards strokes whose predicted landing is the target, and which clear the net."""
        actions = self._actor(torch.cat([situations, torch.tensor(normal_goals(goals_m))], 1))
        strokes = self._strokes(played, actions)
        predicted = self._head.decode(self._model(torch.cat([situations, actions], 1)), strokes)
        off = predicted[:, :2] - torch.tensor(goals_m, dtype=torch.float32)
        distances = (off.square().sum(1) + SOFT_M**2).sqrt()
        missing = (NET_HEIGHT_M + BALL_RADIUS_M + self._config.net_margin_m - predicted[:, 2]).relu()
        return descend((distances + self._config.net_weight * missing).mean(), self._actor_optimizer)

    def policy(self) -> Policy:
        """The actor by itself."""
        incoming, racket = racket_table(self._run)
        state = self._run.environment.state
        sees = not self._chooses_speed
        return Policy(layers_of(self._actor), "relu", "tanh", sees, incoming, racket, state, self._chooses_speed)

    def to_arrays(self) -> Arrays:
        """Parameters and moments of both networks."""
        actor = network_to_arrays("actor", self._actor, self._actor_optimizer)
        return actor | network_to_arrays("model", self._model, self._model_optimizer)

    def restore(self, arrays: Arrays) -> None:
        """Load what `to_arrays` gave."""
        restore_network(arrays, "actor", self._actor, self._actor_optimizer)
        restore_network(arrays, "model", self._model, self._model_optimizer)


def make_head(config: RunConfig) -> Head:
    """The head of the run's config."""
    if config.landing_model.head == "impact":
        return ImpactHead(config.environment.task.stroke)
    return FlightHead() if config.landing_model.head == "flight" else FreeHead()
