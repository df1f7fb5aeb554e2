"""Detector settings as a TOML file: the method, and a section for each stage or method."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Final, NamedTuple

from core.config import config_from_mapping, config_to_mapping, read_mapping, write_mapping
from core.detection.config import DetectorConfig
from core.detection.methods import METHODS, SECTIONS, STAGED, UNNAMED_METHOD, Method, method_config, method_named
from core.errors import CommandError, ConfigError

SHARED_SECTIONS = frozenset({"window"})
"""Sections of every method, which do not identify the method of a file."""
RIMLESS: Final = Path(__file__).with_name("rimless.toml")
"""A file with settings of `refined` for a ball without a rim."""


class SavedDetector(NamedTuple):
    """A method and its settings."""

    method: Method
    config: DetectorConfig


def load_detector(path: Path) -> SavedDetector:
    """The method and the settings of a file.

    Settings that are absent have the defaults of the method that the file names. A file that names none was written
    when there was no such key: see `method_of_sections`.

    Raises:
        ConfigError: if the file is missing, is not TOML, or holds a setting or a method that does not exist.
    """
    mapping = dict(read_mapping(path))
    name = mapping.pop("method", None)
    config = config_from_mapping(DetectorConfig, mapping, where=str(path))
    if name is None:
        return SavedDetector(method_of_sections(mapping), config)
    try:
        method = method_named(name)
    except CommandError as error:
        known = " | ".join(METHODS)
        raise ConfigError("no such method", expected=known, got=repr(name), where=f"{path}: method") from error
    if "window_us" not in mapping.get("window", {}):
        config = dataclasses.replace(config, window=method_config(method).window)
    return SavedDetector(method, config)


def save_detector(method: Method, config: DetectorConfig, path: Path) -> None:
    """Write a method with its settings, replacing the file in one step.

    Raises:
        ConfigError: if the folder cannot be written.
    """
    write_mapping({"method": method, **config_to_mapping(config)}, path)


def method_of_sections(mapping: dict[str, object]) -> Method:
    """The method that settings without a name were written for: that whose sections alone they hold, else `auto`."""
    sections = mapping.keys() - SHARED_SECTIONS
    for method, its in SECTIONS.items():
        if method not in STAGED and sections and sections <= set(its):
            return method
    return UNNAMED_METHOD
