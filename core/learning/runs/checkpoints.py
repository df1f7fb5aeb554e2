"""A training between two episodes as one file: arrays and plain values."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from core.errors import ConfigError
from core.files import replace_file
from core.text.json_text import parse_json


def save_checkpoint(path: Path, arrays: dict[str, NDArray[np.generic]], about: dict[str, object]) -> None:
    """Write arrays and plain values in one step: after a kill there is the old file or the new one."""
    data = save({name: np.ascontiguousarray(a) for name, a in arrays.items()}, {"about": json.dumps(about)})
    replace_file(path, data, durable=True)


def load_checkpoint(path: Path) -> tuple[dict[str, NDArray[np.generic]], dict[str, object]]:
    """The opposite.

    Raises:
        ConfigError: if the file is not one.
    """
    try:
        with safe_open(path, "np") as file:
            about = parse_json((file.metadata() or {})["about"])
            return {name: file.get_tensor(name) for name in file.keys()}, about  # noqa: SIM118 - not a mapping
    except (OSError, SafetensorError, KeyError, ValueError) as error:
        raise ConfigError("not a checkpoint", got=str(error), where=path, remedy="delete it to start over") from error
