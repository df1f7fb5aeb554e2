"""Small networks on one thread: a two-hidden-layer perceptron with its gradient written out, and Adam.

At batch 64 and 64 units the arithmetic of an update takes a tenth of a millisecond, and what an automatic gradient and
a general optimiser add around it takes five times that. So all parameters of a network lie in one tensor, the backward
pass is eight lines, and an Adam step is a handful of operations. Nothing here draws random numbers but `numpy`'s
generator at the start, so a run repeats bit for bit.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

LAST_LAYER = 3e-3
"""Half the range of the last layer's initial parameters: a new actor acts near zero, a new critic knows nothing."""


class Mlp:
    """inputs -> hidden -> hidden -> outputs with ReLU; float32."""

    def __init__(
        self, inputs: int, outputs: int, hidden: int, rng: np.random.Generator, *, last_layer: float | None = LAST_LAYER
    ) -> None:
        sizes = [inputs, hidden, hidden, outputs]
        shapes = [shape for a, b in itertools.pairwise(sizes) for shape in ((a, b), (b,))]
        count = sum(math.prod(shape) for shape in shapes)
        self.parameters = torch.zeros(count)
        self.gradient = torch.zeros(count)
        self._p = _views(self.parameters, shapes)
        self._g = _views(self.gradient, shapes)
        for layer, (weight, bias) in enumerate(zip(self._p[::2], self._p[1::2], strict=True)):
            width = 1 / math.sqrt(sizes[layer])
            if layer == 2 and last_layer is not None:
                width = last_layer
            for tensor in (weight, bias):
                tensor.copy_(torch.from_numpy(rng.uniform(-width, width, tuple(tensor.shape))))
        self._x = self._h1 = self._h2 = torch.zeros(0)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs (B, outputs) of x (B, inputs), kept for `backward`."""
        w1, b1, w2, b2, w3, b3 = self._p
        self._x = x
        self._h1 = torch.addmm(b1, x, w1).relu_()
        self._h2 = torch.addmm(b2, self._h1, w2).relu_()
        return torch.addmm(b3, self._h2, w3)

    def backward(self, dy: Tensor, *, parameters: bool = True, inputs: bool = False) -> Tensor:
        """Given d loss / d outputs of the last `forward`, fill `gradient`; gives d loss / d inputs if asked, or dy."""
        w1, _, w2, _, w3, _ = self._p
        d2 = torch.mm(dy, w3.t()).mul_(self._h2 > 0)
        d1 = torch.mm(d2, w2.t()).mul_(self._h1 > 0)
        if parameters:
            g1, c1, g2, c2, g3, c3 = self._g
            torch.mm(self._h2.t(), dy, out=g3)
            torch.sum(dy, 0, out=c3)
            torch.mm(self._h1.t(), d2, out=g2)
            torch.sum(d2, 0, out=c2)
            torch.mm(self._x.t(), d1, out=g1)
            torch.sum(d1, 0, out=c1)
        return torch.mm(d1, w1.t()) if inputs else dy

    def layers(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Copies of weight (in, out) and bias (out,) of each layer."""
        return [(w.numpy().copy(), b.numpy().copy()) for w, b in zip(self._p[::2], self._p[1::2], strict=True)]

    def arrays(self, name: str) -> dict[str, NDArray[np.generic]]:
        """The parameters under `name`, for a checkpoint."""
        return {name: self.parameters.numpy().copy()}

    def restore(self, arrays: dict[str, NDArray[np.generic]], name: str) -> None:
        """The opposite."""
        self.parameters.copy_(torch.from_numpy(arrays[name]))


class Adam:
    """Adam (Kingma and Ba 2015) on the one tensor of a network."""

    def __init__(self, network: Mlp, rate: float) -> None:
        self.rate = rate
        self._network = network
        self.mean = torch.zeros_like(network.parameters)
        self.square = torch.zeros_like(network.parameters)
        self.steps = 0

    def step(self, *, rate_share: float = 1.0) -> None:
        """Move the parameters against the network's gradient."""
        g = self._network.gradient
        self.steps += 1
        self.mean.lerp_(g, 0.1)
        self.square.mul_(0.999).addcmul_(g, g, value=0.001)
        correction = math.sqrt(1 - 0.999**self.steps)
        size = self.rate * rate_share / (1 - 0.9**self.steps)
        self._network.parameters.addcdiv_(self.mean, self.square.sqrt().div_(correction).add_(1e-8), value=-size)

    def arrays(self, name: str) -> dict[str, NDArray[np.generic]]:
        """The moments under `name`, for a checkpoint."""
        moments = {"mean": self.mean.numpy().copy(), "square": self.square.numpy().copy()}
        return {f"{name}.{key}": value for key, value in moments.items()} | {f"{name}.steps": np.array([self.steps])}

    def restore(self, arrays: dict[str, NDArray[np.generic]], name: str) -> None:
        """The opposite."""
        self.mean.copy_(torch.from_numpy(arrays[f"{name}.mean"]))
        self.square.copy_(torch.from_numpy(arrays[f"{name}.square"]))
        self.steps = int(arrays[f"{name}.steps"][0])


def _views(flat: Tensor, shapes: list[tuple[int, ...]]) -> list[Tensor]:
    views, start = [], 0
    for shape in shapes:
        end = start + math.prod(shape)
        views.append(flat[start:end].view(shape))
        start = end
    return views
