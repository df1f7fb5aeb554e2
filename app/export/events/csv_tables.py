"""Everything in a recording as plain tables: events, truth, and the chain's own columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from app.export.events.event_slices import check_cameras, event_slices, share_of
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, unfinished_folder
from core.recordings import Recording
from core.recordings.layout import BALL_GROUP, Rows, truth_group

Columns = dict[str, NDArray]
EXTRA_GROUPS: Final = {"/racket": "t_us", "/racket_targets": "t_us", "/predictions": "t_us", "/episodes": "serve_us"}
"""Groups of the chain and the names of their time columns."""


def export_csv(
    recording: Recording,
    folder: Path,
    span: Span,
    *,
    groups: Callable[[str], Rows | None] = lambda group: None,
    overwrite: bool = False,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> tuple[Path, ...]:
    """Write `<camera>.csv` (t_us,x_px,y_px,on) for every camera, and a table for each other group that there is.

    Times are the recording's. `groups` reads its groups, such as "/racket".

    Raises:
        CommandError: if a file exists or cannot be written.
        ExportCancelledError: if `cancelled()` is true; nothing is written then.
    """
    cameras = check_cameras(recording)
    tables = _tables(cameras, span, groups)
    names = [f"{name}.csv" for name in [*cameras, *tables]]
    with unfinished_folder(folder, names, overwrite=overwrite) as unfinished:
        for number, name in enumerate(cameras):
            slices = event_slices(recording.cameras[name], span, share_of(number, len(cameras), progress), cancelled)
            parts = (
                {
                    "t_us": one.t_us + span.start_us,
                    "x_px": one.x_px,
                    "y_px": one.y_px,
                    "on": one.on.astype(np.uint8),
                }
                for one in slices
            )
            _write(unfinished / f"{name}.csv", parts)
        for name, columns in tables.items():
            _write(unfinished / f"{name}.csv", [columns])
    return tuple(folder / name for name in names)


def _tables(cameras: list[str], span: Span, groups: Callable[[str], Rows | None]) -> dict[str, Columns]:
    clocks = {BALL_GROUP: "t_us", **{truth_group(name): "t_us" for name in cameras}, **EXTRA_GROUPS}
    tables: dict[str, Columns] = {}
    for group, clock in clocks.items():
        rows = groups(group)
        if rows is not None:
            inside = (span.start_us <= rows[clock]) & (rows[clock] < span.end_us)
            ordered = {clock: rows[clock], **rows}
            tables[group.strip("/").replace("/", "_")] = dict(
                _flat((name, column[inside]) for name, column in ordered.items())
            )
    return tables


def _flat(columns: Iterable[tuple[str, NDArray]]) -> Iterator[tuple[str, NDArray]]:
    """A column for each component: p_world_m of three becomes p_world_m_0, p_world_m_1, p_world_m_2."""
    for name, column in columns:
        if column.ndim == 1:
            yield name, column.astype(np.uint8) if column.dtype == np.bool_ else column
            continue
        wide = column.reshape(len(column), int(np.prod(column.shape[1:])))
        for k in range(wide.shape[1]):
            yield f"{name}_{k}", wide[:, k]


def _write(path: Path, parts: Iterable[Columns]) -> None:
    options = csv.WriteOptions(include_header=False, quoting_style="none")  # its header would have quotes
    with path.open("wb") as file:
        for number, columns in enumerate(parts):
            if number == 0:
                file.write((",".join(columns) + "\n").encode())
            csv.write_csv(pa.table({name: _arrow(column) for name, column in columns.items()}), file, options)


def _arrow(column: NDArray) -> pa.Array:
    if column.dtype.kind == "S":
        return pa.array([text.decode(errors="replace").replace(",", " ") for text in column.tolist()], pa.string())
    return pa.array(np.ascontiguousarray(column))
