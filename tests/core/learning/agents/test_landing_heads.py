"""The physics inside the landing model: known landings, and finite numbers where there are none."""

import numpy as np
import pytest
import torch

from core.learning.agents.landing_model import (
    GRIP,
    PUSH_MPS,
    RESTITUTION,
    Balls,
    FlightHead,
    ImpactHead,
)
from core.physics.episode import Arrivals, strokes_from_actions
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import follow_hits, return_balls

pytestmark = pytest.mark.numeric


def outputs_for(velocities: np.ndarray) -> torch.Tensor:
    centre, scale = np.array([3.5, 0.0, 1.5]), np.array([1.2, 0.8, 1.2])
    return torch.tensor((velocities - centre) / scale, dtype=torch.float32)


def balls_at(ps: np.ndarray, vs: np.ndarray | None = None, actions: np.ndarray | None = None) -> Balls:
    """Balls at the racket, which moves at 1 m/s."""
    n = len(ps)
    vs = np.tile([-4.0, 0.2, 1.0], (n, 1)) if vs is None else vs
    actions = np.zeros((n, 3)) if actions is None else actions
    parts = np.concatenate([ps, vs], axis=1), np.full((n, 1), 1.0), actions
    return Balls(*(torch.tensor(part, dtype=torch.float32) for part in parts))


def test_the_parabola_lands_where_the_simulator_lets_the_ball_land() -> None:
    rng = np.random.default_rng(0)
    n = 200
    ps = np.column_stack([np.full(n, -1.42), rng.uniform(-0.3, 0.3, n), rng.uniform(0.1, 0.4, n)])
    vs = rng.uniform([2.0, -1.0, 0.0], [6.0, 1.0, 3.0], (n, 3))
    outcomes = follow_hits(np.zeros(n), np.concatenate([ps, vs, np.zeros((n, 3))], axis=1), TaskConfig())
    decoded = FlightHead().decode(outputs_for(vs), balls_at(ps)).numpy()
    np.testing.assert_allclose(decoded[:, :2], outcomes.landings_m, atol=1e-4)
    np.testing.assert_allclose(decoded[:, 2], outcomes.net_z_m, atol=1e-4)


def test_the_law_of_reflection_with_the_simulator_s_numbers_is_the_simulator() -> None:
    """A spinless ball on a rubber of known restitution and grip: the head needs no push."""
    rng = np.random.default_rng(2)
    n = 100
    task = TaskConfig()
    ps = rng.uniform([-1.42, -0.3, 0.1], [-1.42, 0.3, 0.4], (n, 3))
    vs, actions = rng.uniform([-6, -0.5, 0], [-3, 0.5, 2], (n, 3)), rng.uniform(-1, 1, (n, 3))
    states = np.concatenate([ps, vs, np.zeros((n, 3))], axis=1)
    arrivals = Arrivals(np.ones(n, np.bool_), np.zeros(n), states, np.zeros(n), states)
    outcomes = return_balls(arrivals, strokes_from_actions(actions, np.ones(n), task.stroke), task)
    numbers = [(0.78 - RESTITUTION[0]) / RESTITUTION[1], (0.4 - GRIP[0]) / GRIP[1], 0, 0, 0]
    decoded = ImpactHead(task.stroke).decode(torch.tensor([numbers] * n), balls_at(ps, vs, actions)).numpy()
    there = ~np.isnan(outcomes.net_z_m)
    assert there.sum() > 80
    np.testing.assert_allclose(decoded[there, :2], outcomes.landings_m[there], atol=2e-3)
    np.testing.assert_allclose(decoded[there, 2], outcomes.net_z_m[there], atol=2e-3)
    assert PUSH_MPS < 0.1  # what is learned last explains little


def test_a_ball_that_flies_backwards_gives_finite_numbers() -> None:
    outputs = outputs_for(np.array([[-2.0, 0.0, -3.0]])).requires_grad_()
    decoded = FlightHead().decode(outputs, balls_at(np.array([[-1.42, 0.0, -0.5]])))
    assert decoded.isfinite().all()
    assert torch.autograd.grad(decoded.sum(), outputs)[0].isfinite().all()


def test_what_is_told_of_a_spinning_ball_is_the_simulator_s_law() -> None:
    """With its true restitution and grip the head reflects a ball of any spin as the simulator does."""
    rng = np.random.default_rng(0)
    count, task = 40, TaskConfig()
    p, v = np.tile([-1.42, 0.1, 0.3], (count, 1)), rng.normal((-4, 0, -0.5), 0.3, (count, 3))
    spin, actions = rng.uniform(-150, 150, (count, 3)), rng.uniform(-1, 1, (count, 3))
    states = np.concatenate([p, v, spin], axis=1)
    legal, t_s = np.ones(count, np.bool_), np.ones(count)
    arrivals = Arrivals(legal, t_s, states, t_s, states)
    outcomes = return_balls(arrivals, strokes_from_actions(actions, 1.0, task.stroke), task)
    rubber = task.physics.rubber
    outputs = np.zeros((count, 5))
    outputs[:, 0] = (rubber.restitution - RESTITUTION[0]) / RESTITUTION[1]
    outputs[:, 1] = (0.4 - GRIP[0]) / GRIP[1]  # a shell whose contact point sticks
    known = np.concatenate([states, np.zeros((count, 3))], axis=1)
    balls = Balls(*(torch.tensor(a, dtype=torch.float64) for a in (known, np.ones((count, 1)), actions)))
    head = ImpactHead(task.stroke)
    head._base = head._base.double()
    found = head.decode(torch.tensor(outputs), balls).numpy()
    np.testing.assert_allclose(found[:, :2], outcomes.landings_m, atol=1e-6)
