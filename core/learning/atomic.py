"""Files that are replaced in one step: after a kill there is the old one or the new one, never half of one."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from core.errors import ConfigError


def save_checkpoint(path: Path, arrays: dict[str, NDArray[np.generic]], about: dict[str, object]) -> None:
    """Write arrays and plain values in one step: after a kill there is the old file or the new one."""
    data = save({name: np.ascontiguousarray(a) for name, a in arrays.items()}, {"about": json.dumps(about)})
    replace_file(path, data)


def load_checkpoint(path: Path) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
    """The opposite.

    Raises:
        ConfigError: if the file is not one.
    """
    try:
        with safe_open(path, "np") as file:
            about = json.loads((file.metadata() or {})["about"])
            return {name: file.get_tensor(name) for name in file.keys()}, about  # noqa: SIM118 - not a mapping
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise ConfigError("not a checkpoint", got=str(error), where=path, remedy="delete it to start over") from error


def write_json(path: Path, value: object) -> None:
    """Write a JSON file in one step."""
    replace_file(path, json.dumps(value).encode(), durable=False)


def read_json(path: Path) -> dict[str, object]:
    """An object from a JSON file; empty if there is none."""
    try:
        value = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}


def replace_file(path: Path, data: bytes, *, durable: bool = True) -> None:
    """Write a file in one step; `durable` waits until it is on the disk."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    with partial.open("wb") as file:
        file.write(data)
        if durable:
            file.flush()
            os.fsync(file.fileno())
    os.replace(partial, path)
