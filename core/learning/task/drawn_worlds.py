"""The world of each ball under domain randomisation: its constants of flight and impact.

They are drawn with the ball, so that playing an action stays deterministic.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.learning.randomisation import RandomisationConfig
from core.physics.config import PhysicsConfig
from core.physics.episode import Arrivals, Serves
from core.physics.task import TaskConfig
from core.simulation.episodes.closed_form import draw_serves, fly_serves, sample_serves

Array = NDArray[np.float64]
Columns = TypeVar("Columns")

CONSTANTS: Final = (
    ("air", "drag_coefficient"),
    ("table", "restitution"),
    ("table", "friction"),
    ("rubber", "restitution"),
    ("rubber", "tangential_restitution"),
)
"""The constants that differ, in the order of their columns: section and field of `PhysicsConfig`."""
LOWEST: Final = np.array([0.0, 0.5, 0.0, 0.3, 0.0])
HIGHEST: Final = np.array([1.0, 1.0, 1.0, 1.0, 0.95])
"""Bounds of the fields, where a draw is cut off."""


def draw_constants(
    count: int, physics: PhysicsConfig, ranges: RandomisationConfig, rng: np.random.Generator
) -> Array | None:
    """Constants (count, 5) of each ball's world, columns as `CONSTANTS`; None if none of them differs."""
    if not (ranges.physics or ranges.rubber):
        return None
    usual = np.array([getattr(getattr(physics, section), name) for section, name in CONSTANTS])
    air_table = np.array([ranges.drag * usual[0], ranges.table_restitution, ranges.table_friction])
    rubber = np.array([ranges.rubber_restitution, ranges.rubber_grip])
    half = np.concatenate([ranges.physics * air_table, ranges.rubber * rubber])
    return np.clip(usual + half * rng.uniform(-1, 1, (count, len(CONSTANTS))), LOWEST, HIGHEST)


def with_constants(task: TaskConfig, constants: Array) -> TaskConfig:
    """The task in the world of one ball.

    Args:
        task: with the usual constants.
        constants: (5,) as `CONSTANTS`.

    Raises:
        ConfigError: if one is out of its bounds.
    """
    sections: dict[str, dict[str, float]] = {}
    for (section, name), value in zip(CONSTANTS, constants, strict=True):
        sections.setdefault(section, {})[name] = float(value)
    physics = task.physics
    changed = {name: dataclasses.replace(getattr(physics, name), **fields) for name, fields in sections.items()}
    return dataclasses.replace(task, physics=dataclasses.replace(physics, **changed))


def draw_differing_serves(
    speed_mps: float, constants: Array, task: TaskConfig, rng: np.random.Generator
) -> tuple[Serves, Arrivals]:
    """A serve of one speed per row of constants (N, 5), legal in its own world, and its arrival there.

    Raises:
        ConfigError: if there is none.
    """
    served, arrived = [], []
    for row in constants:
        own = with_constants(task, row)
        served.append(draw_serves(speed_mps, 1, own, rng))
        arrived.append(fly_serves(served[-1], own))
    return join_rows(served), join_rows(arrived)


def sample_differing_serves(
    serves: Serves, arrivals: Arrivals, t_s: Array, task: TaskConfig, constants: Array | None
) -> Array:
    """`sample_serves` with constants (N, 5) of each ball's world; None: those of the task."""
    if constants is None or not task.physics.has_air:  # between contacts only the air's constants count
        return sample_serves(serves, arrivals, t_s, task)
    positions = np.empty((*t_s.shape, 3))
    for i, row in enumerate(constants):
        one = slice(i, i + 1)
        own = with_constants(task, row)
        positions[one] = sample_serves(serves[one], select_arrivals(arrivals, one), t_s[one], own)
    return positions


def select_arrivals(a: Arrivals, which: slice | NDArray[np.bool_] | NDArray[np.intp]) -> Arrivals:
    """Some of the arrivals."""
    return Arrivals(a.legal[which], a.bounce_t_s[which], a.bounce_states[which], a.t_s[which], a.states[which])


def equal_rows(constants: Array) -> list[slice]:
    """The rows (N, 5) in stretches of one world each."""
    starts = [0, *(np.flatnonzero((constants[1:] != constants[:-1]).any(axis=1)) + 1).tolist(), len(constants)]
    return [slice(start, end) for start, end in itertools.pairwise(starts) if start < end]


def join_rows(parts: list[Columns]) -> Columns:
    """One value of a dataclass of arrays from several, row below row.

    Args:
        parts: at least one.
    """
    first: Any = parts[0]
    columns = {item.name: [getattr(part, item.name) for part in parts] for item in dataclasses.fields(first)}
    return type(first)(**{name: np.concatenate(column) for name, column in columns.items()})
