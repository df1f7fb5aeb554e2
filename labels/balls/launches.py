"""Selected balls as launches that a policy is trained on: `train --balls FILE`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from core.errors import CommandError
from core.physics.ball_states import write_ball_states
from core.physics.episode import Serves
from labels.balls.table import STATE

LAUNCHED: Final = ("flight", "stroke")
"""Kinds whose state is just after a stroke or a serve; a bounce's or a net touch's is in the middle of a flight."""
FEWEST: Final = 9
"""Fewer flights have none for one of training, validation and test, see `core.learning.task.environment`."""
ORIGIN: Final = ("source", "name", "kind", "number", "t_us", "method")


@dataclass(frozen=True, slots=True)
class WrittenLaunches:
    """What became of the selected rows."""

    written: int
    unknown: int
    """Flights and strokes without a known position, velocity or spin."""


def write_launches(path: Path, rows: pa.Table) -> WrittenLaunches:
    """Write the flights and strokes of these rows as ball states; a stroke and the flight that it begins count once.

    Args:
        path: the file, JSON.
        rows: of the ball index, see `table.COLUMNS`.

    Raises:
        CommandError: if too few of them have a known state.
        RecordingError: if the file cannot be written.
    """
    is_launched = np.isin(np.array(rows.column("kind").to_pylist(), object), LAUNCHED)
    launched = rows.filter(pa.array(is_launched))
    states = np.column_stack([launched.column(name).to_numpy() for name in STATE]).reshape(-1, len(STATE))
    is_known = np.isfinite(states).all(axis=1)
    origins = launched.select(ORIGIN).to_pylist()
    first: dict[tuple[object, ...], int] = {}
    for row in np.flatnonzero(is_known).tolist():
        origin = origins[row]
        first.setdefault((origin["source"], origin["name"], *states[row].tolist()), row)
    kept = list(first.values())
    unknown = int(np.count_nonzero(~is_known))
    if len(kept) < FEWEST:
        raise CommandError(
            "too few balls to train on",
            expected=f"{FEWEST} or more flights or strokes with a known position, velocity and spin",
            got=f"{len(kept)}, and {unknown} whose state is not known",
        )
    found = states[kept]
    write_ball_states(path, Serves(found[:, :3], found[:, 3:6], found[:, 6:]), [origins[row] for row in kept])
    return WrittenLaunches(len(kept), unknown)
