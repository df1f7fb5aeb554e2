"""A policy file holds numbers, and one that does not fit is refused with a clear line."""

import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from core.errors import ConfigError
from core.learning.agents.policy import FORMAT, Policy, read_policy, save_policy

pytestmark = pytest.mark.numeric


def a_policy(inputs: int = 8) -> Policy:
    rng = np.random.default_rng(0)
    shapes = [(inputs, 4), (4, 4), (4, 3)]
    layers = tuple((rng.normal(size=s).astype(np.float32), rng.normal(size=s[1]).astype(np.float32)) for s in shapes)
    table = np.array([1.9, 4.1], np.float32), np.array([3.0, 1.0], np.float32)
    return Policy(layers, "relu", "tanh", inputs == 9, *table)


def test_a_policy_comes_back_the_same_and_equal_policies_are_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        save_policy(a_policy(), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    again = read_policy(tmp_path / "a")
    state, goal = [-1.42, 0.1, 0.3, -4.0, 0.0, 1.0], [0.7, 0.2]
    np.testing.assert_array_equal(again.act(state, goal), a_policy().act(state, goal))


def test_the_racket_speed_is_read_off_the_arriving_ball() -> None:
    policy = a_policy()
    speeds = [policy.racket_speed_mps([-1.42, 0, 0.3, vx, 0, 0]) for vx in (-0.5, -1.9, -3.0, -4.1, -9.0)]
    assert speeds == pytest.approx([3, 3, 2, 1, 1])


@pytest.mark.parametrize(
    ("about", "tensors", "told"),
    [
        ({}, {}, "not a policy of ours"),
        ({"format": FORMAT}, {}, "incomplete"),
        (
            {"format": FORMAT, "hidden": "relu", "output": "tanh", "sees_racket_speed": False},
            {"inputs": 7},
            "do not fit",
        ),
        ({"format": FORMAT, "hidden": "exp", "output": "tanh", "sees_racket_speed": False}, {"inputs": 8}, "unknown"),
        (
            {"format": FORMAT, "hidden": "relu", "output": "tanh", "sees_racket_speed": "no"},
            {"inputs": 8},
            "policy for",
        ),
        ({"format": FORMAT, "hidden": "relu", "output": "tanh", "sees_racket_speed": False}, {"nan": 8}, "not finite"),
        (
            {"format": FORMAT, "hidden": "relu", "output": "tanh", "sees_racket_speed": False},
            {"huge": 8},
            "no training gives",
        ),
    ],
)
def test_a_file_that_does_not_fit_is_refused(
    about: dict[str, object], tensors: dict[str, int], told: str, tmp_path: Path
) -> None:
    arrays = {"incoming_mps": np.ones(1, np.float32), "racket_mps": np.ones(1, np.float32)}
    for kind, inputs in tensors.items():
        arrays["weight_0"] = np.full((inputs, 3), {"nan": np.nan, "huge": 3e37}.get(kind, 0.0), np.float32)
        arrays["bias_0"] = np.zeros(3, np.float32)
    save_file(arrays, tmp_path / "policy", {"about": json.dumps(about)})
    with pytest.raises(ConfigError, match=told):
        read_policy(tmp_path / "policy")


def test_no_file_and_no_safetensors_are_told(tmp_path: Path) -> None:
    (tmp_path / "junk").write_bytes(b"\x80\x04not numbers")
    for name in ("junk", "absent"):
        with pytest.raises(ConfigError, match="cannot read the policy"):
            read_policy(tmp_path / name)


def with_spin() -> Policy:
    rng = np.random.default_rng(0)
    layer = rng.normal(size=(14, 3)).astype(np.float32), np.zeros(3, np.float32)
    table = np.array([1.9, 4.1], np.float32), np.array([3.0, 1.0], np.float32)
    return Policy((layer,), "relu", "tanh", False, *table, "spin")


def test_a_policy_says_which_states_it_needs_and_plays_no_others(tmp_path: Path) -> None:
    save_policy(with_spin(), tmp_path / "spin")
    save_policy(a_policy(), tmp_path / "plain")
    assert (read_policy(tmp_path / "spin").state, read_policy(tmp_path / "plain").state) == ("spin", "plain")
    state, goal = np.array([-1.42, 0.1, 0.3, -4.0, 0.0, 1.0]), [0.7, 0.2]
    known = np.concatenate([state, [10.0, -150.0, 5.0, 1.0, 1.0, 1.0]])
    assert np.abs(with_spin().act(known, goal)).max() <= 1
    for policy, wrong in ((with_spin(), state), (a_policy(), known)):
        with pytest.raises(ConfigError, match=f"states of the kind {policy.state}"):
            policy.act(wrong, goal)


def test_the_spin_and_its_uncertainty_turn_the_racket() -> None:
    base = np.array([-1.42, 0.1, 0.3, -4.0, 0.0, 1.0, 0.0, -120.0, 0.0, 0.0, 0.0, 0.0])
    actions = [with_spin().act(base + 5 * np.eye(12)[k], [0.7, 0.2]) for k in range(6, 12)]
    assert all(np.abs(action - with_spin().act(base, [0.7, 0.2])).max() > 1e-4 for action in actions)


def test_a_file_for_states_of_an_unknown_kind_is_refused(tmp_path: Path) -> None:
    about = {"format": FORMAT, "hidden": "relu", "output": "tanh", "sees_racket_speed": False, "state": "touch"}
    layer: dict[str, np.ndarray] = {"weight_0": np.zeros((8, 3), np.float32), "bias_0": np.zeros(3, np.float32)}
    table = {"incoming_mps": np.ones(1, np.float32), "racket_mps": np.ones(1, np.float32)}
    save_file({**layer, **table}, tmp_path / "odd", {"about": json.dumps(about)})
    with pytest.raises(ConfigError, match="states of another kind"):
        read_policy(tmp_path / "odd")
