"""A detector config as its differences from another, and back: for links and stored settings."""

from __future__ import annotations

from collections.abc import Mapping

from core.config import field_specs, get_setting, replace_setting
from core.detection import DetectorConfig
from core.detection.methods import STAGED, Method, method_config
from core.errors import ConfigError


def default_config(method: Method) -> DetectorConfig:
    """Default config of a method in the app."""
    return DetectorConfig() if method in STAGED else method_config(method)


def differing_settings(config: DetectorConfig, base: DetectorConfig) -> dict[str, object]:
    """Settings of `config` that differ from `base`, by their dotted path, as JSON values."""
    found: dict[str, object] = {}
    for spec in field_specs(DetectorConfig):
        value = get_setting(config, spec.path)
        if value != get_setting(base, spec.path):
            found[".".join(spec.path)] = list(value) if isinstance(value, tuple) else value
    return found


def with_settings(base: DetectorConfig, settings: Mapping[str, object]) -> DetectorConfig:
    """`base` with these settings.

    Settings may go together only all at once, so they are tried again after the others until none is left that fits.

    Raises:
        ConfigError: if one is no setting, or out of range, or does not go with the others.
    """
    known = {".".join(spec.path): spec for spec in field_specs(DetectorConfig)}
    left = dict(settings)
    while left:
        problem: ConfigError | None = None
        for name, value in list(left.items()):
            spec = known.get(name)
            if spec is None:
                raise ConfigError("no such setting", expected="one of the detector's", got=name[:80])
            if isinstance(value, list):
                value = tuple(value)
            elif spec.kind is float and isinstance(value, int) and not isinstance(value, bool):
                value = float(value)
            if not isinstance(value, (bool, int, float, str, tuple)):
                raise ConfigError("not a value of a setting", expected="a number, a text or a list", where=name)
            try:
                base = replace_setting(base, spec.path, value)
            except ConfigError as error:
                problem = error
            else:
                del left[name]
                break
        else:
            assert problem is not None
            raise problem
    return base
