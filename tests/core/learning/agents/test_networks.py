"""Networks start near zero from their seed alone, follow softly, and come back from a checkpoint as they were."""

import numpy as np
import pytest
import torch

from core.learning.agents.networks import (
    adam,
    descend,
    layers_of,
    mlp,
    network_to_arrays,
    restore_network,
    soft_update,
)

pytestmark = pytest.mark.numeric


def test_a_new_network_answers_nearly_zero_and_depends_on_its_seed_alone() -> None:
    before = torch.random.get_rng_state()
    a, b = (mlp(4, 2, 32, np.random.default_rng(3)) for _ in range(2))
    assert torch.equal(before, torch.random.get_rng_state())
    assert float(a(torch.ones(6, 4)).detach().abs().max()) < 0.05
    for ours, theirs in zip(a.parameters(), b.parameters(), strict=True):
        assert torch.equal(ours, theirs)


def test_a_soft_update_moves_the_target_by_the_share_tau_of_the_way() -> None:
    target, source = torch.nn.Linear(2, 1), torch.nn.Linear(2, 1)
    with torch.no_grad():
        target.weight.copy_(torch.tensor([[1.0, -2.0]]))
        source.weight.copy_(torch.tensor([[3.0, 2.0]]))
        target.bias.fill_(0.0)
        source.bias.fill_(8.0)
    soft_update(target, source, 0.25)
    assert target.weight.tolist() == [[1.5, -1.0]] and target.bias.tolist() == [2.0]
    soft_update(target, source, 0.25)
    assert target.weight.tolist() == [[1.875, -0.25]] and target.bias.tolist() == [3.5]
    assert source.weight.tolist() == [[3.0, 2.0]]
    soft_update(target, source, 1.0)
    assert target.weight.tolist() == [[3.0, 2.0]] and target.bias.tolist() == [8.0]


def test_a_step_changes_only_what_the_optimiser_holds() -> None:
    rng = np.random.default_rng(0)
    ours, others = mlp(3, 2, 8, rng), mlp(2, 1, 8, rng)
    kept = [parameter.clone() for parameter in others.parameters()]
    optimizer = adam(ours, 0.01)
    x = torch.randn(16, 3, generator=torch.Generator().manual_seed(0))
    losses = [descend((others(ours(x)) - 1).square().mean(), optimizer) for _ in range(5)]
    assert losses == sorted(losses, reverse=True)
    for parameter, before in zip(others.parameters(), kept, strict=True):
        assert torch.equal(parameter, before) and parameter.grad is None


def test_a_restored_network_goes_on_bit_for_bit() -> None:
    x = torch.randn(16, 3, generator=torch.Generator().manual_seed(0))
    ours = mlp(3, 2, 8, np.random.default_rng(0))
    optimizer = adam(ours, 0.01)
    for _ in range(3):
        descend((ours(x) - 1).square().mean(), optimizer)
    again = mlp(3, 2, 8, np.random.default_rng(1))
    optimizer_again = adam(again, 0.01)
    restore_network(network_to_arrays("net", ours, optimizer), "net", again, optimizer_again)
    for _ in range(3):
        descend((ours(x) - 1).square().mean(), optimizer)
        descend((again(x) - 1).square().mean(), optimizer_again)
    for name, array in network_to_arrays("net", ours, optimizer).items():
        np.testing.assert_array_equal(network_to_arrays("net", again, optimizer_again)[name], array, err_msg=name)


def test_the_arrays_of_a_network_are_weight_in_out_and_bias_of_each_layer() -> None:
    network = mlp(3, 2, 8, np.random.default_rng(0))
    flat = np.concatenate([part.reshape(-1) for layer in layers_of(network) for part in layer])
    np.testing.assert_array_equal(network_to_arrays("net", network)["net"], flat)
    weight, bias = layers_of(network)[0]
    assert weight.shape == (3, 8) and bias.shape == (8,)
    x = np.ones((1, 3), np.float32)
    for i, (weight, bias) in enumerate(layers_of(network)):
        x = x @ weight + bias if i == 2 else np.maximum(x @ weight + bias, 0)
    np.testing.assert_allclose(network(torch.ones(1, 3)).detach().numpy(), x, rtol=1e-5)


def test_another_network_s_arrays_do_not_fit() -> None:
    arrays = network_to_arrays("net", mlp(3, 2, 8, np.random.default_rng(0)))
    with pytest.raises(RuntimeError):
        restore_network(arrays, "net", mlp(3, 2, 16, np.random.default_rng(0)))
    with pytest.raises(KeyError):
        restore_network(arrays, "other", mlp(3, 2, 8, np.random.default_rng(0)))
