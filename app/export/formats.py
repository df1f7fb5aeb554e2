"""All formats by name, and one way to make any of them: for the command line and for the app."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

from app.export.selection import DEFAULT_STRIDE_US, Span, span_of
from app.export.unfinished import Cancelled, Progress
from core.chain import ChainConfig
from core.errors import CommandError
from core.recordings import Recording
from core.recordings.layout import Rows
from labels.arrays import LabelArrays


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """One format that the app can export to."""

    what: str
    suffix: str
    folder: bool = False
    """Several files in a folder instead of one."""
    of_runs: bool = False
    """Of training runs."""
    of_recordings: bool = True


FORMATS: Final = {
    "rrd": ExportFormat("a Rerun recording: 3D, pictures with the detector's stages, curves", ".rrd", of_runs=True),
    "html": ExportFormat("the 3D scene with playback as one web page", ".html"),
    "viser": ExportFormat("the 3D scene with playback for viser's own player", ".viser"),
    "mp4": ExportFormat(
        "a film: 3D drawing and event pictures; of a training run every 10th ball", ".mp4", of_runs=True
    ),
    "png": ExportFormat("a picture of the end of the part: 3D drawing and event pictures", ".png"),
    "dsec": ExportFormat("event files in DSEC's HDF5 layout, one per camera", "", folder=True),
    "evt3": ExportFormat("Prophesee RAW files (EVT3), one per camera", "", folder=True),
    "mcap": ExportFormat("an MCAP file for Foxglove: events, pictures, detections and 3D as ROS 2 messages", ".mcap"),
    "rosbag": ExportFormat("a ROS 2 bag: events as EventPackets (EVT3) and calibration", "", folder=True),
    "csv": ExportFormat("events, truth and the chain's columns as tables", "", folder=True),
    "onnx": ExportFormat("the actor of a training run as an ONNX graph", ".onnx", of_runs=True, of_recordings=False),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportRequest:
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
    chain: ChainConfig = field(default_factory=lambda: ChainConfig.of_method("auto"))
    overwrite: bool = False
    seed: int | None = None
    """Of a run: whose actor or film; None: its first."""
    policy: Literal["last", "best"] = "last"


def is_run(path: Path) -> bool:
    """Whether it is the folder of a training run."""
    return (path / "config.toml").is_file()


def export(
    order: ExportRequest,
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
    source, fits = ("recording", "of_recordings") if recording is not None else ("training run", "of_runs")
    if not getattr(FORMATS[order.format], fits):
        known = ", ".join(f"--{name}" for name, kind in FORMATS.items() if getattr(kind, fits))
        raise CommandError(f"a {source} has no such export", expected=known, got=f"--{order.format}")
    if recording is None:
        if run is None:
            raise CommandError("nothing to export")
        return (_export_run(order, run, progress, cancelled),)
    span = span_of(recording, order.start_us, order.end_us)
    return _EXPORTS[order.format](_Task(order, recording, span, groups, labels or {}, progress, cancelled))


def _export_run(order: ExportRequest, run: Path, progress: Progress, cancelled: Cancelled) -> Path:
    if order.format == "onnx":
        try:
            from app.export.onnx_actor import export_actor
        except ImportError as error:
            raise CommandError("an ONNX file needs onnx", remedy="pip install 'rallyscope[onnx]'") from error
        return export_actor(run, order.destination, seed=order.seed, which=order.policy, overwrite=order.overwrite)
    if order.format == "mp4":
        from app.export.scenes.training_film import export_training_film

        return export_training_film(
            run, order.destination, seed=order.seed, overwrite=order.overwrite, progress=progress, cancelled=cancelled
        )
    from app.export.rrd.run import export_run

    return export_run(run, order.destination, overwrite=order.overwrite, progress=progress, cancelled=cancelled)


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """An order with everything that it takes."""

    order: ExportRequest
    recording: Recording
    span: Span
    groups: Callable[[str], Rows | None]
    labels: Mapping[str, LabelArrays]
    progress: Progress
    cancelled: Cancelled

    @property
    def path(self) -> Path:
        return self.order.destination


# The formats are imported when they are asked for: each loads what only it needs.


def _rrd(task: _Task) -> tuple[Path, ...]:
    from app.export.rrd.recording import RrdContents, export_rrd

    order = task.order
    contents = RrdContents(
        chain=order.chain,
        stride_us=order.stride_us or DEFAULT_STRIDE_US,
        pictures=order.pictures,
        stages=order.stages,
        plots=order.plots,
        labels=task.labels,
    )
    made = export_rrd(
        task.recording, task.path, task.span, contents, groups=task.groups, overwrite=order.overwrite,
        progress=task.progress, cancelled=task.cancelled,
    )  # fmt: skip
    return (made,)


def _csv(task: _Task) -> tuple[Path, ...]:
    from app.export.events.csv_tables import export_csv

    return export_csv(
        task.recording, task.path, task.span, groups=task.groups, overwrite=task.order.overwrite,
        progress=task.progress, cancelled=task.cancelled,
    )  # fmt: skip


def _dsec(task: _Task) -> tuple[Path, ...]:
    from app.export.events.dsec import export_dsec

    return export_dsec(
        task.recording, task.path, task.span, overwrite=task.order.overwrite, progress=task.progress,
        cancelled=task.cancelled,
    )  # fmt: skip


def _evt3(task: _Task) -> tuple[Path, ...]:
    from app.export.events.evt3 import export_evt3

    return export_evt3(
        task.recording, task.path, task.span, overwrite=task.order.overwrite, progress=task.progress,
        cancelled=task.cancelled,
    )  # fmt: skip


def _mcap(task: _Task) -> tuple[Path, ...]:
    from app.export.ros.recording import export_mcap

    made = export_mcap(
        task.recording, task.path, task.span, task.order.chain, stride_us=task.order.stride_us or DEFAULT_STRIDE_US,
        groups=task.groups, overwrite=task.order.overwrite, progress=task.progress, cancelled=task.cancelled,
    )  # fmt: skip
    return (made,)


def _rosbag(task: _Task) -> tuple[Path, ...]:
    from app.export.ros.recording import export_rosbag

    return export_rosbag(
        task.recording, task.path, task.span, overwrite=task.order.overwrite, progress=task.progress,
        cancelled=task.cancelled,
    )  # fmt: skip


def _film(task: _Task) -> tuple[Path, ...]:
    from app.export.scenes.drawn_picture import STRIDE_US, export_mp4

    made = export_mp4(
        task.recording, task.path, task.span, task.order.chain, stride_us=task.order.stride_us or STRIDE_US,
        groups=task.groups, overwrite=task.order.overwrite, progress=task.progress, cancelled=task.cancelled,
    )  # fmt: skip
    return (made,)


def _still(task: _Task) -> tuple[Path, ...]:
    from app.export.scenes.drawn_picture import export_png

    made = export_png(
        task.recording, task.path, task.span, task.order.chain, groups=task.groups, overwrite=task.order.overwrite,
        progress=task.progress, cancelled=task.cancelled,
    )  # fmt: skip
    return (made,)


def _scene(task: _Task) -> tuple[Path, ...]:
    from app.export.scenes.scene_file import STRIDE_US, export_scene

    made = export_scene(
        task.recording, task.path, task.span, task.order.chain, as_html=task.order.format == "html",
        stride_us=task.order.stride_us or STRIDE_US, groups=task.groups, overwrite=task.order.overwrite,
        progress=task.progress, cancelled=task.cancelled,
    )  # fmt: skip
    return (made,)


_EXPORTS: Final[dict[str, Callable[[_Task], tuple[Path, ...]]]] = {
    "rrd": _rrd,
    "html": _scene,
    "viser": _scene,
    "mp4": _film,
    "png": _still,
    "dsec": _dsec,
    "evt3": _evt3,
    "mcap": _mcap,
    "rosbag": _rosbag,
    "csv": _csv,
}
