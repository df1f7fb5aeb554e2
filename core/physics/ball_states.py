"""Ball states just after a stroke, of human play or of selected flights, as a list of JSON objects."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import WRITE_REMEDY, RecordingError
from core.files import replace_file
from core.physics.episode import Serves
from core.text import parse_json

Array = NDArray[np.float64]

KEYS: Final = ("pos_x", "pos_y", "pos_z", "vel_x", "vel_y", "vel_z", "w_vel_x", "w_vel_y", "w_vel_z")
"""Keys of one state, besides an id: position in metres, velocity in m/s, spin in rad/s. X along the table's width, Y
along its length, Z up, origin at the centre of the table's top surface."""
MAX_BYTES: Final = 64 << 20
MAX_STATES: Final = 200_000
FARTHEST_M: Final = 5.0
FASTEST_MPS: Final = 40.0
MAX_SPIN_RADPS: Final = 1500.0
"""Above what play has: up to 28 m/s and 956 rad/s in a public match."""
FORM: Final = "a JSON list of ball states, each with " + ", ".join(KEYS)


def read_ball_states(path: Path) -> Serves:
    """The states in the world frame, all flying to -x: those that fly the other way are turned half round.

    Raises:
        RecordingError: if it cannot be read, is no such list, or a state is impossible.
    """
    states = _as_array(_read_json(path), path)
    bad = ~np.isfinite(states).all(axis=1)
    bad |= (np.abs(states[:, :3]) > FARTHEST_M).any(axis=1)
    bad |= np.linalg.norm(states[:, 3:6], axis=1) > FASTEST_MPS
    bad |= np.linalg.norm(states[:, 6:], axis=1) > MAX_SPIN_RADPS
    if bad.any():
        first = int(np.argmax(bad))
        limits = f"within {FARTHEST_M:g} m, {FASTEST_MPS:g} m/s, {MAX_SPIN_RADPS:g} rad/s"
        got = str(states[first].tolist())[:200]
        raise RecordingError("no possible ball", expected=limits, got=got, where=f"{path}, state {first}")
    ps, vs, spins = (_to_world(states[:, k : k + 3]) for k in (0, 3, 6))
    away = vs[:, 0] > 0
    for vectors in (ps, vs, spins):
        vectors[away, :2] *= -1
    return Serves(ps, vs, spins)


def write_ball_states(path: Path, serves: Serves, origins: Sequence[Mapping[str, object]]) -> None:
    """Write states that `read_ball_states` reads; `origins`: N entries that say where each state is from.

    Raises:
        RecordingError: if the file cannot be written.
    """
    columns = [np.stack([-v[:, 1], v[:, 0], v[:, 2]], axis=1) for v in (serves.ps_m, serves.vs_mps, serves.spins_radps)]
    rows = np.concatenate(columns, axis=1).tolist()
    states = [{**origin, **dict(zip(KEYS, row, strict=True))} for origin, row in zip(origins, rows, strict=True)]
    try:
        replace_file(path, json.dumps(states, indent=1).encode(), durable=True)
    except OSError as error:
        raise RecordingError(
            "cannot write the ball states", got=error.strerror, where=path, remedy=WRITE_REMEDY
        ) from error


def join_serves(parts: list[Serves]) -> Serves:
    """Concatenate serves."""
    columns = zip(*((part.ps_m, part.vs_mps, part.spins_radps) for part in parts), strict=True)
    return Serves(*(np.concatenate(column) for column in columns))


def _to_world(vectors: Array) -> Array:
    """Vectors turned a quarter about z: +y of the file is +x of the world."""
    return np.stack([vectors[:, 1], -vectors[:, 0], vectors[:, 2]], axis=1)


def _read_json(path: Path) -> list[object]:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            limit = f"up to {MAX_BYTES >> 20} MiB"
            raise RecordingError("too large a file of ball states", expected=limit, got=f"{size} bytes", where=path)
        found = parse_json(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise RecordingError("cannot read the ball states", got=error.strerror, where=path) from error
    except (ValueError, RecursionError) as error:
        raise RecordingError("not JSON", expected=FORM, got=str(error)[:100], where=path) from error
    if not isinstance(found, list) or not found:
        raise RecordingError("no list of ball states", expected=FORM, got=type(found).__name__, where=path)
    if len(found) > MAX_STATES:
        raise RecordingError("too many ball states", expected=f"up to {MAX_STATES}", got=len(found), where=path)
    return found


def _as_array(found: list[object], path: Path) -> Array:
    rows = np.empty((len(found), len(KEYS)))
    for number, state in enumerate(found):
        values = [state.get(key) for key in KEYS] if isinstance(state, dict) else []
        if len(values) != len(KEYS) or not all(type(value) in (int, float) for value in values):
            raise RecordingError("not a ball state", expected=FORM, got=repr(state)[:100], where=f"{path}, {number}")
        try:
            rows[number] = values
        except OverflowError:  # an int that is longer than any float
            rows[number] = np.inf
    return rows
