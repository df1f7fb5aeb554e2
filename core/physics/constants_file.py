"""Constants of air and table with their uncertainties, as `rallyscope fit-physics` writes them (JSON)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from core.errors import ConfigError
from core.physics.config import PhysicsConfig, physics_profile
from core.table import FittedConstant
from core.text import parse_json

MAX_BYTES: Final = 50_000_000
"""A report also lists every flight; more is no report."""
REMEDY: Final = "write it with `rallyscope fit-physics FLIGHTS... --out FILE`"
FITTED: Final = ("drag_coefficient", "restitution", "friction")


@dataclass(frozen=True, slots=True)
class FittedConstants:
    """Air and table as recorded flights have them; the racket is not among them."""

    drag_coefficient: FittedConstant
    restitution: FittedConstant
    friction: FittedConstant
    magnus_coefficient: float
    """Given to the fit, not fitted: flights fix only its product with the spin."""

    def physics(self) -> PhysicsConfig:
        """The profile `real` with these constants."""
        real = physics_profile("real")
        drag, magnus = self.drag_coefficient.value, self.magnus_coefficient
        air = replace(real.air, drag_coefficient=drag, magnus_coefficient=magnus)
        table = replace(real.table, restitution=self.restitution.value, friction=self.friction.value)
        return replace(real, air=air, table=table)


def read_constants(path: Path) -> FittedConstants:
    """The constants of a report of `fit-physics`.

    Raises:
        ConfigError: if the file cannot be read, lacks a constant, or has a value that no ball or table has.
    """
    report = _read_json(path)
    drag, restitution, friction = (_read_constant(report, name, path) for name in FITTED)
    magnus = _read_number(report.get("magnus_coefficient"), "magnus_coefficient", path)
    constants = FittedConstants(drag, restitution, friction, magnus)
    try:
        constants.physics()  # checks the ranges
    except ConfigError as error:
        raise ConfigError(f"not the constants of a ball and a table: {error}", where=path) from None
    return constants


def _read_json(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            text = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ConfigError("cannot read the constants", got=error.strerror, where=path) from error
    try:
        report = parse_json(text) if len(text) <= MAX_BYTES else None
    except ValueError:
        report = None
    if not isinstance(report, dict):
        raise ConfigError("not a report of constants", expected="JSON", where=path, remedy=REMEDY)
    return report


def _read_constant(report: dict[str, Any], name: str, path: Path) -> FittedConstant:
    entry = report.get(name)
    if not isinstance(entry, dict):
        raise ConfigError(f"no `{name}`", expected='{"value": ..., "sigma": ...}', got=entry, where=path, remedy=REMEDY)
    value, sigma = (_read_number(entry.get(key), f"{name}.{key}", path) for key in ("value", "sigma"))
    if sigma < 0:
        raise ConfigError(f"`{name}.sigma` is no spread", expected="0 or more", got=sigma, where=path)
    return FittedConstant(value, sigma)


def _read_number(value: object, name: str, path: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ConfigError(f"`{name}` is no number", expected="a number", got=value, where=path, remedy=REMEDY)
    return float(value)
