"""The agents' networks in torch: perceptrons, their optimiser, target networks, and how all of it is stored."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

Arrays = dict[str, NDArray[np.generic]]

LAST_LAYER = 3e-3
"""Half the range of the last layer's initial parameters: a new actor or critic gives nearly zero."""


def mlp(inputs: int, outputs: int, hidden: int, rng: np.random.Generator) -> nn.Sequential:
    """inputs -> hidden -> hidden -> outputs with ReLU between; its parameters depend on `rng` alone."""
    sizes = (inputs, hidden), (hidden, hidden), (hidden, outputs)
    layers = [nn.utils.skip_init(nn.Linear, *size) for size in sizes]
    with torch.no_grad():
        for layer, (fan_in, _) in zip(layers, sizes, strict=True):
            width = LAST_LAYER if layer is layers[-1] else 1 / math.sqrt(fan_in)
            for parameter in layer.parameters():
                parameter.copy_(torch.from_numpy(rng.uniform(-width, width, tuple(parameter.t().shape))).t())
    return nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2])


def adam(network: nn.Module, learning_rate: float) -> torch.optim.Adam:
    """Adam for a network; fused, as on networks this small the calls cost more than the arithmetic."""
    return torch.optim.Adam(network.parameters(), lr=learning_rate, fused=True)


def descend(loss: Tensor, optimizer: torch.optim.Optimizer) -> float:
    """Take one step of the optimiser down the loss, in its own parameters and no others; gives the loss."""
    optimizer.zero_grad()
    loss.backward(inputs=optimizer.param_groups[0]["params"])
    optimizer.step()
    return float(loss.detach())


@torch.no_grad()
def soft_update(target: nn.Module, source: nn.Module, tau: float) -> None:
    """target <- tau source + (1 - tau) target."""
    for following, parameter in zip(target.parameters(), source.parameters(), strict=True):
        following.lerp_(parameter, tau)


def layers_of(modules: Iterable[nn.Module]) -> tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]:
    """Copies of weight (in, out) and bias (out,) of each linear layer, as a policy holds them."""
    linear = [module for module in modules if isinstance(module, nn.Linear)]
    return tuple((m.weight.detach().numpy().T.copy(), m.bias.detach().numpy().copy()) for m in linear)


def network_to_arrays(name: str, network: nn.Module, optimizer: torch.optim.Adam | None = None) -> Arrays:
    """The parameters in one array, weight (in, out) and bias (out,) of each layer; and so the moments of Adam."""
    parameters = list(network.parameters())
    arrays: Arrays = {name: _flat(parameters)}
    if optimizer is not None and optimizer.state:
        states = [optimizer.state[parameter] for parameter in parameters]
        arrays[f"{name}.mean"] = _flat([state["exp_avg"] for state in states])
        arrays[f"{name}.square"] = _flat([state["exp_avg_sq"] for state in states])
        arrays[f"{name}.steps"] = np.array([int(states[0]["step"])])
    return arrays


def restore_network(arrays: Arrays, name: str, network: nn.Module, optimizer: torch.optim.Adam | None = None) -> None:
    """Restore a network from the arrays.

    Raises:
        KeyError, RuntimeError: if they are another network's.
    """
    parameters = list(network.parameters())
    with torch.no_grad():
        for parameter, value in zip(parameters, _unflat(arrays[name], parameters), strict=True):
            parameter.copy_(value)
    if optimizer is not None and f"{name}.steps" in arrays:
        means, squares = (_unflat(arrays[f"{name}.{moment}"], parameters) for moment in ("mean", "square"))
        for parameter, mean, square in zip(parameters, means, squares, strict=True):
            step = torch.tensor(float(arrays[f"{name}.steps"][0]))
            optimizer.state[parameter] = {"step": step, "exp_avg": mean, "exp_avg_sq": square}


def _flat(tensors: Sequence[Tensor]) -> NDArray[np.float32]:
    return torch.cat([tensor.detach().t().reshape(-1) for tensor in tensors]).numpy()


def _unflat(array: NDArray[np.generic], like: Sequence[Tensor]) -> list[Tensor]:
    """Tensors of their own memory: where a matrix begins in memory can change how its products are rounded."""
    parts = torch.from_numpy(array).split([tensor.numel() for tensor in like])
    shaped = [part.view(tensor.t().shape).t() for part, tensor in zip(parts, like, strict=True)]
    return [part.clone(memory_format=torch.contiguous_format) for part in shaped]
