"""Biases as TOML: a table for each camera, by model and serial number, or for each model, which serves two of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import tomli_w

from core.devices.models import MODELS, check_biases
from core.errors import WRITE_REMEDY, ConfigError
from core.files import replace_file
from core.text.toml_text import parse_toml

LARGEST_BYTES: Final = 64 << 10

BiasSets = dict[str, dict[str, int]]
"""Bias values by name, by model, or by model and serial number separated by a space."""


def read_biases(path: Path) -> BiasSets:
    """The biases in a file, each within the bounds of its model.

    Raises:
        ConfigError: if it cannot be read, is no TOML, or has a model, a bias or a value that there is not.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError("cannot read the biases", got=error.strerror, where=path) from error
    if len(data) > LARGEST_BYTES:
        raise ConfigError("too long for biases", expected=f"up to {LARGEST_BYTES} bytes", got=len(data), where=path)
    try:
        tables = parse_toml(data.decode("utf-8-sig"))
    except ValueError as error:  # of TOML, and of UTF-8
        raise ConfigError("not a TOML file", got=str(error), where=path) from error
    found: BiasSets = {}
    for name, values in tables.items():
        model = MODELS.get(name) or MODELS.get(name.rpartition(" ")[0])
        if model is None or not isinstance(values, dict):
            raise ConfigError(
                "no such model of camera",
                expected=f"{' or '.join(MODELS)}, and a serial number behind it if wanted",
                got=name,
                where=path,
            )
        check_biases(model.biases, values, f"{path}, [{name}]")
        found[name] = dict(values)
    return found


def write_biases(path: Path, sets: Mapping[str, Mapping[str, int]]) -> None:
    """Write them so that `read_biases` gives them again.

    Raises:
        ConfigError: if the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, tomli_w.dumps({name: dict(values) for name, values in sets.items()}).encode(), durable=True)
    except OSError as error:
        raise ConfigError("cannot write the biases", got=error.strerror, where=path, remedy=WRITE_REMEDY) from error
