"""All formats by name, and one way to make any of them: for the command line and for the app."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from app.export.selection import DEFAULT_STRIDE_US, span_of
from app.export.unfinished import Cancelled, Progress
from core.errors import CommandError
from core.rally import ChainConfig
from core.recordings import Recording
from core.recordings.layout import Rows
from labels.arrays import LabelArrays


@dataclass(frozen=True, slots=True)
class Format:
    """One of them."""

    what: str
    suffix: str
    folder: bool = False
    """Several files in a folder instead of one."""
    of_runs: bool = False
    """Also of training runs."""


FORMATS: Final = {
    "rrd": Format("a Rerun recording: 3D, pictures with the detector's stages, curves", ".rrd", of_runs=True),
    "dsec": Format("event files in DSEC's HDF5 layout, one per camera", "", folder=True),
    "evt3": Format("Prophesee RAW files (EVT3), one per camera", "", folder=True),
    "csv": Format("events, truth and the chain's columns as tables", "", folder=True),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """What is to be made."""

    format: str
    destination: Path
    start_us: int | None = None
    end_us: int | None = None
    stride_us: int | None = None
    """Between two pictures; None: as the format likes it."""
    pictures: bool = True
    stages: bool = True
    plots: bool = True
    chain: ChainConfig = field(default_factory=ChainConfig)
    overwrite: bool = False


def is_run(path: Path) -> bool:
    """Whether it is the folder of a training run."""
    return (path / "config.toml").is_file()


def export(
    order: Order,
    *,
    recording: Recording | None = None,
    run: Path | None = None,
    groups: Callable[[str], Rows | None] = lambda group: None,
    labels: Mapping[str, LabelArrays] | None = None,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> tuple[Path, ...]:
    """Make it of a recording or of a run; returns the files.

    Raises:
        RallyscopeError: if it cannot be made.
        ExportCancelledError: if `cancelled` said so; nothing is left behind then.
    """
    if recording is None:
        if not FORMATS[order.format].of_runs:
            known = ", ".join(f"--{name}" for name, kind in FORMATS.items() if kind.of_runs)
            raise CommandError("a training run has no such export", expected=known, got=f"--{order.format}")
        if run is None:
            raise CommandError("nothing to export")
        from app.export.rrd_run import export_run

        return (export_run(run, order.destination, overwrite=order.overwrite, progress=progress, cancelled=cancelled),)
    span = span_of(recording, order.start_us, order.end_us)
    path = order.destination
    if order.format == "rrd":
        from app.export.rrd import RrdContents, export_rrd

        contents = RrdContents(
            chain=order.chain,
            stride_us=order.stride_us or DEFAULT_STRIDE_US,
            pictures=order.pictures,
            stages=order.stages,
            plots=order.plots,
            labels=labels or {},
        )
        made = export_rrd(
            recording, path, span, contents, groups=groups, overwrite=order.overwrite, progress=progress,
            cancelled=cancelled,
        )  # fmt: skip
        return (made,)
    if order.format == "csv":
        from app.export.csv_tables import export_csv

        return export_csv(
            recording, path, span, groups=groups, overwrite=order.overwrite, progress=progress, cancelled=cancelled
        )
    from app.export.dsec import export_dsec
    from app.export.evt3 import export_evt3

    write = export_dsec if order.format == "dsec" else export_evt3
    return write(recording, path, span, overwrite=order.overwrite, progress=progress, cancelled=cancelled)
