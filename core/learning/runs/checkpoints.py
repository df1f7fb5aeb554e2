"""Checkpoint of a training between two episodes, one file of arrays and plain values."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from core.errors import ConfigError
from core.files import replace_file
from core.learning.agents.agent import Agent
from core.learning.agents.replay import ReplayBuffer
from core.text.json_text import parse_json

AGENT: Final = "agent."
BUFFER: Final = "buffer."
"""Prefix of the buffer's arrays."""


def save_checkpoint(path: Path, arrays: dict[str, NDArray[np.generic]], about: dict[str, object]) -> None:
    """Write arrays and plain values atomically."""
    data = save({name: np.ascontiguousarray(a) for name, a in arrays.items()}, {"about": json.dumps(about)})
    replace_file(path, data, durable=True)


def pack_arrays(agent: Agent, buffer: ReplayBuffer) -> dict[str, NDArray[np.generic]]:
    """Arrays of agent and replay buffer, by their names in a checkpoint."""
    arrays: dict[str, NDArray[np.generic]] = {f"{AGENT}{name}": array for name, array in agent.to_arrays().items()}
    return arrays | {f"{BUFFER}{name}": array for name, array in buffer.to_arrays().items()}


def restore_arrays(arrays: dict[str, NDArray[np.generic]], agent: Agent, buffer: ReplayBuffer) -> None:
    """Load what `pack_arrays` gave.

    Raises:
        KeyError, ValueError, TypeError, RuntimeError: if they are another agent's.
    """
    agent.restore({k.removeprefix(AGENT): v for k, v in arrays.items() if k.startswith(AGENT)})
    balls = {k.removeprefix(BUFFER): v for k, v in arrays.items() if k.startswith(BUFFER)}
    buffer.restore(balls)  # type: ignore[arg-type]


def load_checkpoint(path: Path) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
    """Load a checkpoint that `save_checkpoint` wrote.

    Raises:
        ConfigError: if the file is not one.
    """
    try:
        with safe_open(path, "np") as file:
            about = parse_json((file.metadata() or {})["about"])
            return {name: file.get_tensor(name) for name in file.keys()}, about  # noqa: SIM118 - not a mapping
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise ConfigError("not a checkpoint", got=str(error), where=path, remedy="delete it to start over") from error
