"""The form of a new training: values for the fields of `RunConfig`, as a browser sent them, and the run they mean."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Final

from app.modes.train.presets import MAX_STAGES, SOURCES, offered_agents
from core.config import FieldSpec, config_from_mapping, config_to_mapping, field_specs, get_setting
from core.errors import ConfigError
from core.learning.config import RunConfig, default_run

Path = tuple[str, ...]

MAIN: Final[tuple[Path, ...]] = (
    ("agent",),
    ("reward", "kind"),
    ("curriculum", "speeds_mps"),
    ("curriculum", "episodes"),
    ("curriculum", "advance"),
    ("curriculum", "replay"),
    ("environment", "state_source"),
    ("seeds",),
    ("first_seed",),
)
"""What most people change; everything else is folded away."""
NOT_HERE: Final = (("environment", "task"), ("environment", "recorded"))
LONGEST_NUMBER: Final = 12
LARGEST_WHOLE: Final = 2.0**53
"""A browser knows only floats; beyond this they skip whole numbers."""


def form_specs() -> tuple[FieldSpec, ...]:
    """The fields of the form, the main ones first; the physics of the task is the simulation's and no part of it, and
    files of recorded balls are for the command line.
    """
    specs = {spec.path: spec for spec in field_specs(RunConfig) if spec.path[:2] not in NOT_HERE}
    offered = {("agent",): offered_agents(), ("environment", "state_source"): SOURCES}
    for path, choices in offered.items():
        specs[path] = dataclasses.replace(specs[path], choices=choices)
    return (*(specs.pop(path) for path in MAIN), *specs.values())


def value_shown(config: RunConfig, spec: FieldSpec) -> bool | int | float | str:
    """The value of a field as its control shows it: equal numbers of a list once."""
    value = get_setting(config, spec.path)
    if not isinstance(value, tuple):
        return value
    shown = value[:1] if len(set(value)) == 1 else value
    return ", ".join(f"{number:g}" for number in shown)


def agent_defaults(agent: str) -> dict[Path, bool | int | float | str]:
    """What the folded fields show when an agent is chosen: its defaults. The main ones stay what the person made them.

    Raises:
        ConfigError: if there is no such agent.
    """
    specs = form_specs()
    run = default_run(_value(specs[0], agent))  # type: ignore[arg-type]
    return {spec.path: value_shown(run, spec) for spec in specs[len(MAIN) :]}


def run_of_form(base: RunConfig, values: Mapping[Path, object]) -> RunConfig:
    """`base` with the values of the form, which may be anything.

    Raises:
        ConfigError: if a value is none that its field can have, or they do not go together.
    """
    mapping = config_to_mapping(base)
    specs = {spec.path: spec for spec in form_specs()}
    for path, value in values.items():
        where: dict = mapping
        for name in path[:-1]:
            where = where.setdefault(name, {})  # of a registered section that is as it comes
        where[path[-1]] = _value(specs[path], value)
    curriculum = mapping["curriculum"]
    assert isinstance(curriculum, dict)
    if len(curriculum["episodes"]) == 1:  # one number is for all stages
        curriculum["episodes"] = curriculum["episodes"] * len(curriculum["speeds_mps"])
    return config_from_mapping(RunConfig, mapping, where="the form")


def _value(spec: FieldSpec, value: object) -> object:
    if spec.is_list:
        return _numbers(spec, str(value))
    if spec.kind is int and isinstance(value, float) and value.is_integer() and abs(value) < LARGEST_WHOLE:
        return int(value)
    if spec.choices and value not in spec.choices:
        expected = ", ".join(spec.choices)
        raise ConfigError("not offered", expected=expected, got=repr(value)[:80], where=spec.path[-1])
    return value


def _numbers(spec: FieldSpec, text: str) -> tuple[float, ...]:
    """What a person typed: "3, 5"."""
    parts = text[: 2 * MAX_STAGES * LONGEST_NUMBER].replace(",", " ").split()
    try:
        if not 1 <= len(parts) <= MAX_STAGES or any(len(part) > LONGEST_NUMBER for part in parts):
            raise ValueError(text)
        return tuple(spec.kind(part) for part in parts)
    except ValueError:
        expected = f"1 to {MAX_STAGES} numbers, such as 3, 5"
        raise ConfigError(
            "not a list of numbers", expected=expected, got=repr(text[:80]), where=spec.path[-1]
        ) from None
