"""Names in an exported Rerun recording, conversions at its boundary, and writing the file under a temporary name;
Rerun itself packs it at the end.
"""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike, NDArray

from app.export.unfinished import Cancelled, check_cancelled, unfinished_file
from core.errors import RecordingError
from core.files import utf8_path
from core.text import encodable

Part = TypeVar("Part")
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


def known(part: Callable[..., Part], **settings: object) -> Part:
    """A part of a file with those settings that this version of Rerun has.

    In 0.26 the time panel does not play by itself and the eye has no place: there the viewer takes its own.
    """
    names = inspect.signature(part).parameters
    return part(**{name: value for name, value in settings.items() if name in names})


def time_column(t_us: ArrayLike) -> rr.TimeColumn:
    """The time column for rows at recording times."""
    return rr.TimeColumn(TIMELINE, duration=np.asarray(t_us, np.int64).astype("timedelta64[us]"))


def send(stream: rr.RecordingStream, path: str, times: rr.TimeColumn, columns: rr.ComponentColumnList) -> None:
    """A row per time of some components of one entity."""
    stream.send_columns(path, [times], columns)


def one_a_row(columns: rr.ComponentColumnList, rows: int) -> rr.ComponentColumnList:
    """Columns with one item in each row; rerun-sdk 0.26 would take the three numbers of a colour for three rows."""
    return columns.partition([1] * rows)


def send_scalars(stream: rr.RecordingStream, path: str, t_us: ArrayLike, values: ArrayLike) -> None:
    """A curve; rows that are not finite become a gap.

    Args:
        stream: where it goes.
        path: entity of the curve.
        t_us: (N,) times.
        values: (N,) heights.
    """
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


@contextmanager
def rerun_file(
    path: Path, blueprint: rrb.Blueprint, *, recording_id: str, overwrite: bool, cancelled: Cancelled
) -> Iterator[rr.RecordingStream]:
    """The stream to log to; at the end of the block it becomes the file. If the block raises, there is no file.

    Raises:
        CommandError: if the file exists and `overwrite` is not set, or it cannot be written.
        ExportCancelledError: if `cancelled()` is true.
    """
    with unfinished_file(path, overwrite=overwrite) as unfinished, utf8_path(unfinished.parent) as folder:
        raw = folder / "raw.rrd"
        stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
        stream.save(raw, default_blueprint=blueprint)
        try:
            stream.send_recording_name(encodable(path.stem))
            yield stream
            stream.flush()
        finally:
            stream.disconnect()
        check_cancelled(cancelled)
        _optimize(raw, unfinished)
        check_cancelled(cancelled)


def _optimize(raw: Path, path: Path) -> None:
    """Let Rerun pack the file: fewer and larger chunks open faster."""
    packed = raw.with_name("packed.rrd")
    names = [raw.name, "-o", packed.name]  # in their folder and of our own: Rerun takes no name that is not UTF-8
    done = _rerun("optimize", names, raw.parent)
    if "unrecognized subcommand" in done.stderr:  # its name in rerun-sdk 0.26
        done = _rerun("compact", names, raw.parent)
    if done.returncode or not packed.is_file():
        raise RecordingError("Rerun could not optimize its file", got=(done.stderr or done.stdout)[-300:])
    packed.replace(path)


def _rerun(verb: str, names: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "rerun", "rrd", verb, *names]
    return subprocess.run(command, cwd=folder, capture_output=True, encoding="utf-8", errors="replace", check=False)
