"""The written-out gradient and the written-out optimiser against torch's own."""

import numpy as np
import torch

from core.learning.networks import Adam, Mlp


def as_modules(network: Mlp) -> torch.nn.Sequential:
    modules: list[torch.nn.Module] = []
    for weight, bias in network.layers():
        linear = torch.nn.Linear(*weight.shape)
        with torch.no_grad():
            linear.weight.copy_(torch.tensor(weight.T))
            linear.bias.copy_(torch.tensor(bias))
        modules += [linear, torch.nn.ReLU()]
    return torch.nn.Sequential(*modules[:-1])


def test_outputs_and_gradients_are_those_of_automatic_differentiation() -> None:
    rng = np.random.default_rng(1)
    network = Mlp(5, 3, 16, rng, last_layer=None)
    theirs = as_modules(network)
    x = torch.tensor(rng.normal(size=(9, 5)), dtype=torch.float32, requires_grad=True)
    slope = torch.tensor(rng.normal(size=(9, 3)), dtype=torch.float32)
    expected = theirs(x)
    expected.backward(slope)
    got = network.forward(x.detach())
    to_inputs = network.backward(slope, inputs=True)
    torch.testing.assert_close(got, expected.detach())
    assert x.grad is not None
    torch.testing.assert_close(to_inputs, x.grad)
    gradients = []
    for module in theirs:
        if isinstance(module, torch.nn.Linear):
            assert module.weight.grad is not None and module.bias.grad is not None
            gradients += [module.weight.grad.T.reshape(-1), module.bias.grad]
    torch.testing.assert_close(network.gradient, torch.cat(gradients))


def test_adam_takes_the_steps_of_torch_adam() -> None:
    rng = np.random.default_rng(2)
    network = Mlp(2, 1, 8, rng, last_layer=None)
    parameters = network.parameters.clone().requires_grad_()
    theirs = torch.optim.Adam([parameters], lr=3e-3)
    ours = Adam(network, 3e-3)
    for _ in range(20):
        gradient = torch.tensor(rng.normal(size=len(parameters)), dtype=torch.float32)
        network.gradient.copy_(gradient)
        parameters.grad = gradient.clone()
        ours.step()
        theirs.step()
    torch.testing.assert_close(network.parameters, parameters.detach(), rtol=1e-5, atol=1e-7)


def test_a_new_network_answers_nearly_zero_and_depends_on_its_seed_alone() -> None:
    a, b = (Mlp(4, 2, 32, np.random.default_rng(3)) for _ in range(2))
    x = torch.ones(6, 4)
    assert float(a.forward(x).abs().max()) < 0.05
    assert torch.equal(a.parameters, b.parameters)
