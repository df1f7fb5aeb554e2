"""Names in an exported Rerun recording, and conversions at its boundary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

TIMELINE: Final = "recording_time"
"""Microseconds since the start of the recording."""
EPISODE: Final = "episode"
APPLICATION: Final = "rallyscope"

WORLD: Final = "world"
BALL: Final = "world/ball"
TRAIL: Final = "world/ball/trail"
PREDICTION: Final = "world/prediction"
RACKET: Final = "world/racket"
RACKET_TARGET: Final = "world/racket_target"
LANDINGS: Final = "world/landings"
PLOTS: Final = "plots"

HALF_PIXEL: Final = 0.5
"""Rerun counts pixel i as [i, i + 1); here (0.0, 0.0) is the centre of the first pixel."""


def picture_path(camera: str, *, calibrated: bool) -> str:
    """The entity of a camera's pictures; everything drawn on them is below it. Only calibrated ones are in 3D."""
    return f"{WORLD}/cameras/{camera}/picture" if calibrated else f"pictures/{camera}"


def time_column(t_us: ArrayLike) -> rr.TimeColumn:
    """The time column for rows at recording times."""
    return rr.TimeColumn(TIMELINE, duration=np.asarray(t_us, np.int64).astype("timedelta64[us]"))


def send(stream: rr.RecordingStream, path: str, times: rr.TimeColumn, columns: rr.ComponentColumnList) -> None:
    """A row per time of some components of one entity."""
    stream.send_columns(path, [times], columns)


def send_scalars(stream: rr.RecordingStream, path: str, t_us: ArrayLike, values: ArrayLike) -> None:
    """A curve; rows that are not finite become a gap."""
    t, y = np.asarray(t_us, np.int64), np.asarray(values, np.float64)
    if len(t):
        known = np.isfinite(y)
        send(stream, path, time_column(t), rr.Scalars.columns(scalars=y[known]).partition(known.astype(np.int32)))


def lengths_of(rows: Sequence[Sequence | NDArray]) -> list[int]:
    """How many items each row has."""
    return [len(row) for row in rows]


def stacked(rows: Sequence[NDArray], width: int) -> NDArray[np.float32]:
    """Rows of (N, width) below one another, also if there are none."""
    return np.concatenate([np.empty((0, width)), *rows]).astype(np.float32)
