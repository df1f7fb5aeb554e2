"""A trained policy: a small network in numpy, read from a file that contains numbers only.

Nothing of torch or of the training is needed to use one, so the live rally can load it at once.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from core.errors import ConfigError
from core.files import replace_file
from core.learning.config import StateKind
from core.learning.task.normalise import STATE_SIZES, normal_observations
from core.text import parse_json

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

FORMAT = "rallyscope-policy-1"
LARGEST_INPUT = 1e3
"""Largest normalised state or target that is accepted; usual ones are about 1."""
OVERFLOW = 1e37
"""Largest sum within a network, against overflow."""


class ActionSource(Protocol):
    """Anything that decides on a stroke: states (N, 6), racket speeds (N,), targets (N, 2) -> actions (N, 3)."""

    def __call__(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array: ...


@dataclass(frozen=True, slots=True, eq=False)
class Policy:
    """State and target to an action."""

    layers: tuple[tuple[Floats, Floats], ...]
    """Weight (in, out) and bias (out,) of each."""
    hidden: Literal["relu", "tanh"]
    output: Literal["tanh", "clip"]
    sees_racket_speed: bool
    """The racket's speed is the input after the state."""
    incoming_mps: Floats
    """(K,) ascending mean speeds at which the balls of the stages arrive along x, m/s."""
    racket_mps: Floats
    """(K,) the racket's speed for each of `incoming_mps`, m/s: a ball between two stages is met in between."""
    state: StateKind = "plain"
    """Kind of the ball's state that it needs."""
    chooses_speed: bool = False
    """Whether its actions have a fourth part, the racket's speed."""

    def __call__(self, states: Array, racket_speeds_mps: Array, goals_m: Array) -> Array:
        """Actions (N, 3) in [-1, 1] for states (N, 6), with spin (N, 12), racket speeds (N,) and targets (N, 2).

        A policy that chooses the racket's speed gives (N, 4).

        Raises:
            ConfigError: if the states are not of its kind.
        """
        size = STATE_SIZES[self.state]
        if states.shape[1] != size:
            raise ConfigError(
                f"a policy for states of the kind {self.state}",
                expected=f"{size} numbers a ball",
                got=states.shape[1],
                remedy="a policy plays balls that are known as those that it was trained on",
            )
        x = normal_observations(states, goals_m, racket_speeds_mps if self.sees_racket_speed else None)
        for weight, bias in self.layers[:-1]:
            x = x @ weight + bias
            x = np.maximum(x, 0) if self.hidden == "relu" else np.tanh(x)
        weight, bias = self.layers[-1]
        x = x @ weight + bias
        return (np.tanh(x) if self.output == "tanh" else np.clip(x, -1, 1)).astype(np.float64)

    def act(self, state: ArrayLike, goal_m: ArrayLike) -> Array:
        """The action (3,), or with the racket's speed (4,), for one perceived ball.

        Of its state (6,) p_c and v_c, with spin (12,), and the target (2,).
        """
        s = np.asarray(state, np.float64).reshape(1, -1)
        g = np.asarray(goal_m, np.float64).reshape(1, 2)
        return self(s, np.array([self.racket_speed_mps(s[0])]), g)[0]

    def racket_speed_mps(self, state: ArrayLike) -> float:
        """Speed of the racket along +x at the impact with a ball of this state, m/s."""
        return float(np.interp(-np.asarray(state, np.float64)[3], self.incoming_mps, self.racket_mps))


def save_policy(policy: Policy, path: Path) -> None:
    """Write a policy in one step, as safetensors."""
    tensors = {"incoming_mps": policy.incoming_mps, "racket_mps": policy.racket_mps}
    for i, (weight, bias) in enumerate(policy.layers):
        tensors[f"weight_{i}"], tensors[f"bias_{i}"] = weight, bias
    about = {
        "format": FORMAT,
        "hidden": policy.hidden,
        "output": policy.output,
        "sees_racket_speed": policy.sees_racket_speed,
    }
    if policy.state != "plain":
        about["state"] = policy.state
    if policy.chooses_speed:
        about["chooses_speed"] = True
    # One key: the order of several in the file is left to chance, and equal policies are to be equal files.
    data = save(
        {name: np.ascontiguousarray(t, np.float32) for name, t in tensors.items()}, {"about": json.dumps(about)}
    )
    replace_file(path, data, durable=True)


def read_policy(path: Path) -> Policy:
    """The policy in a file.

    Raises:
        ConfigError: if there is none, or the file is another's.
    """
    try:
        with safe_open(path, "np") as file:
            text = (file.metadata() or {}).get("about", "{}")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
    except (OSError, SafetensorError) as error:
        raise ConfigError("cannot read the policy", got=str(error), where=path) from error
    try:
        about = parse_json(text)
        if about.get("format") != FORMAT:
            raise ConfigError("not a policy of ours", expected=FORMAT, got=about.get("format"), where=path)
        count = sum(name.startswith("weight_") for name in tensors)
        layers = tuple((tensors[f"weight_{i}"], tensors[f"bias_{i}"]) for i in range(count))
        hidden, output, sees = about["hidden"], about["output"], about["sees_racket_speed"]
        state, chooses = about.get("state", "plain"), about.get("chooses_speed", False)
        incoming, racket = tensors["incoming_mps"], tensors["racket_mps"]
    except (AttributeError, KeyError, ValueError, RecursionError) as error:
        raise ConfigError("an incomplete policy", got=str(error), where=path) from error
    return _checked(layers, hidden, output, sees, incoming, racket, state, chooses, path)


def _checked(
    layers: tuple[tuple[Floats, Floats], ...],
    hidden: str,
    output: str,
    sees: object,
    incoming: Floats,
    racket: Floats,
    state: object,
    chooses: object,
    path: Path,
) -> Policy:
    kind: StateKind | None = "plain" if state == "plain" else "spin" if state == "spin" else None
    if kind is None:
        raise ConfigError("a policy for states of another kind", expected="plain | spin", got=repr(state), where=path)
    width, largest = STATE_SIZES[kind] + (3 if sees is True else 2), LARGEST_INPUT
    for weight, bias in layers:
        if weight.ndim != 2 or weight.shape[0] != width or bias.shape != (weight.shape[1],):
            raise ConfigError("layers that do not fit", expected=f"{width} inputs", got=weight.shape, where=path)
        if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
            raise ConfigError("a policy with numbers that are not finite", where=path)
        # The largest number that any input can make in a layer: a file whose sums overflow would answer nan on some
        # balls.
        largest = largest * np.abs(weight).sum(0, np.float64).max(initial=0.0) + np.abs(bias).max(initial=0.0)
        width = weight.shape[1]
    if largest > OVERFLOW:
        raise ConfigError("a policy with numbers that no training gives", got=f"sums of {largest:.1e}", where=path)
    wanted = 4 if chooses is True else 3
    fits = width == wanted and len(layers) > 0 and len(incoming) == len(racket) > 0
    if not fits or not isinstance(sees, bool) or not isinstance(chooses, bool):
        raise ConfigError("not a policy for three angles", expected=wanted, got=width, where=path)
    if (hidden != "relu" and hidden != "tanh") or (output != "tanh" and output != "clip"):
        raise ConfigError("unknown functions between layers", got=f"{hidden}, {output}", where=path)
    return Policy(layers, hidden, output, sees, incoming, racket, kind, chooses)
