"""The parabola inside the landing model: known landings, and its written-out derivatives against numerical ones."""

import math

import numpy as np
import pytest
import torch

from core.learning.landing_heads import FlightHead, FreeHead, Head
from core.simulation.physics.simulate import follow_hits
from core.simulation.physics.task import TaskConfig


def outputs_for(velocities: np.ndarray) -> torch.Tensor:
    centre, scale = np.array([3.5, 0.0, 1.5]), np.array([1.2, 0.8, 1.2])
    return torch.tensor((velocities - centre) / scale, dtype=torch.float32)


def test_the_parabola_lands_where_the_simulator_lets_the_ball_land() -> None:
    rng = np.random.default_rng(0)
    n = 200
    ps = np.column_stack([np.full(n, -1.42), rng.uniform(-0.3, 0.3, n), rng.uniform(0.1, 0.4, n)])
    vs = rng.uniform([2.0, -1.0, 0.0], [6.0, 1.0, 3.0], (n, 3))
    outcomes = follow_hits(np.zeros(n), np.concatenate([ps, vs, np.zeros((n, 3))], axis=1), TaskConfig())
    decoded = FlightHead().decode(outputs_for(vs), torch.tensor(ps, dtype=torch.float32)).numpy()
    np.testing.assert_allclose(decoded[:, :2], outcomes.landings_m, atol=1e-4)
    np.testing.assert_allclose(decoded[:, 2], outcomes.net_z_m, atol=1e-4)


@pytest.mark.parametrize("make", [FreeHead, FlightHead])
def test_the_way_back_is_the_derivative(make: type[FreeHead] | type[FlightHead]) -> None:
    rng = np.random.default_rng(1)
    head: Head = make()
    outputs = torch.tensor(rng.normal(0, 0.6, (40, 3)), dtype=torch.float32)
    ps = torch.tensor(rng.uniform([-1.42, -0.3, 0.1], [-1.42, 0.3, 0.4], (40, 3)), dtype=torch.float32)
    slope = torch.tensor(rng.normal(size=(40, 3)), dtype=torch.float32)
    head.decode(outputs, ps)
    got = head.pull(slope)
    step = 1e-2
    for k in range(3):
        shift = torch.zeros(3)
        shift[k] = step
        change = (head.decode(outputs + shift, ps) - head.decode(outputs - shift, ps)) / (2 * step)
        torch.testing.assert_close(got[:, k], (change * slope).sum(1), rtol=2e-2, atol=2e-2)


def test_a_ball_that_flies_backwards_gives_finite_numbers() -> None:
    head = FlightHead()
    decoded = head.decode(outputs_for(np.array([[-2.0, 0.0, -3.0]])), torch.tensor([[-1.42, 0.0, -0.5]]))
    assert all(map(math.isfinite, decoded.flatten().tolist()))
    assert all(map(math.isfinite, head.pull(torch.ones(1, 3)).flatten().tolist()))
