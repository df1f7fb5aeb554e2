"""The parabola inside the landing model: known landings, and its written-out derivatives against numerical ones."""

import math

import numpy as np
import pytest
import torch

from core.learning.landing_heads import GRIP, PUSH_MPS, RESTITUTION, Balls, FlightHead, FreeHead, Head, ImpactHead
from core.simulation.physics.episode import Arrivals, strokes_from_actions
from core.simulation.physics.simulate import follow_hits, return_balls
from core.simulation.physics.task import StrokeConfig, TaskConfig


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


HEADS: dict[str, Head] = {
    "free": FreeHead(),
    "flight": FlightHead(),
    "impact": ImpactHead(StrokeConfig()),
    "impact on a tilted base": ImpactHead(StrokeConfig(base_pitch_deg=10.0)),
}


@pytest.mark.parametrize("name", HEADS)
def test_the_way_back_is_the_derivative(name: str) -> None:
    rng = np.random.default_rng(1)
    head, n, step = HEADS[name], 40, 1e-2
    outputs = torch.tensor(rng.normal(0, 0.6, (n, head.outputs)), dtype=torch.float32)
    ps = rng.uniform([-1.42, -0.3, 0.1], [-1.42, 0.3, 0.4], (n, 3))
    vs, actions = rng.uniform([-6, -0.5, 0], [-3, 0.5, 2], (n, 3)), rng.uniform(-1, 1, (n, 3))
    slope = torch.tensor(rng.normal(size=(n, 3)), dtype=torch.float32)
    head.decode(outputs, balls_at(ps, vs, actions))
    of_outputs, of_actions = head.pull(slope)
    for k in range(head.outputs):
        shift = torch.zeros(head.outputs)
        shift[k] = step
        up, down = (head.decode(outputs + way * shift, balls_at(ps, vs, actions)) for way in (1, -1))
        torch.testing.assert_close(of_outputs[:, k], ((up - down) / (2 * step) * slope).sum(1), rtol=2e-2, atol=2e-2)
    for k in range(3):
        turn = np.eye(3)[k] * step
        up, down = (head.decode(outputs, balls_at(ps, vs, actions + way * turn)) for way in (1, -1))
        expected = ((up - down) / (2 * step) * slope).sum(1)
        found = torch.zeros(n) if of_actions is None else of_actions[:, k]
        torch.testing.assert_close(found, expected, rtol=2e-2, atol=2e-2)


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
    head = FlightHead()
    decoded = head.decode(outputs_for(np.array([[-2.0, 0.0, -3.0]])), balls_at(np.array([[-1.42, 0.0, -0.5]])))
    assert all(map(math.isfinite, decoded.flatten().tolist()))
    assert all(map(math.isfinite, head.pull(torch.ones(1, 3))[0].flatten().tolist()))
