"""All export formats by name, and one function that makes any of them, for the command line and the app."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from app.export.selection import Span, span_of
from app.export.task import ExportRequest, ExportTask, RunTask
from app.export.unfinished import Cancelled, Progress
from core.errors import CommandError, PluginError
from core.extras import require_package
from core.recordings import Recording
from core.recordings.layout import Rows
from core.registry import Registry
from labels.arrays import LabelArrays


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """One format that recordings or runs are exported to, as `register_exporter` describes it."""

    what: str
    label: str
    suffix: str
    export: Callable[[ExportTask], tuple[Path, ...]] | None
    export_run: Callable[[RunTask], tuple[Path, ...]] | None
    computed: bool

    @property
    def folder(self) -> bool:
        """Whether it writes several files into a folder instead of one file."""
        return not self.suffix

    @property
    def of_runs(self) -> bool:
        """Whether training runs are exported."""
        return self.export_run is not None

    @property
    def of_recordings(self) -> bool:
        """Whether recordings are exported."""
        return self.export is not None


FORMATS: Final[Registry[ExportFormat]] = Registry("exporter", "rallyscope.exporters")
"""Every format by name."""


def register_exporter(
    name: str,
    export: Callable[[ExportTask], tuple[Path, ...]] | None,
    label: str,
    suffix: str = "",
    *,
    what: str = "",
    export_run: Callable[[RunTask], tuple[Path, ...]] | None = None,
    computed: bool = False,
) -> None:
    """Add a format of exports: `export --NAME`, and the formats of the mode Export.

    Args:
        name: of the format; `--NAME` on the command line.
        export: makes it of a part of a recording and returns the files; None if it cannot.
        label: what the mode Export calls it; empty: it is for the command line only.
        suffix: of the file, such as ".rrd"; empty: it makes a folder.
        what: a line of help; empty: the label.
        export_run: makes it of a training run; None if it cannot.
        computed: whether it holds what the detector and the chain find, so that their settings matter.

    Raises:
        PluginError: if the name is taken, or one of these does not fit.
    """
    where = f"exporter {name}"
    ways = [way for way in (export, export_run) if way is not None]
    if not ways or not all(map(callable, ways)):
        raise PluginError("no way to make it", expected="export(task) that returns the files", where=where)
    if not isinstance(label, str) or not (what or label).strip():
        raise PluginError("no label", expected="what the format is called", got=repr(label), where=where)
    if not isinstance(suffix, str) or (suffix and not suffix.startswith(".")):
        raise PluginError("not a suffix", expected='such as ".rrd", or none', got=repr(suffix), where=where)
    FORMATS.register(name, ExportFormat(what or label, label, suffix, export, export_run, computed))


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
    """Export a recording or a run; returns the files.

    Args:
        order: format, part, file and settings.
        recording: what is exported, or
        run: the folder of a training run.
        groups: reads further groups of the recording, such as "/racket".
        labels: by camera.
        progress: gets the share that is done.
        cancelled: is asked again and again.

    Raises:
        RallyscopeError: if it cannot be made.
        ExportCancelledError: if `cancelled()` is true; nothing is left behind then.
    """
    chosen = FORMATS[order.format]
    of_recording = recording is not None
    if not (chosen.of_recordings if of_recording else chosen.of_runs):
        source = "recording" if of_recording else "training run"
        fitting = [name for name, kind in FORMATS.items() if (kind.of_recordings if of_recording else kind.of_runs)]
        known = ", ".join(f"--{name}" for name in fitting)
        raise CommandError(f"a {source} has no such export", expected=known, got=f"--{order.format}")
    if recording is not None and chosen.export is not None:
        span = span_of(recording, order.start_us, order.end_us)
        return chosen.export(ExportTask(order, recording, span, groups, labels or {}, progress, cancelled))
    if run is None or chosen.export_run is None:
        raise CommandError("nothing to export")
    return chosen.export_run(RunTask(order, run, progress, cancelled))


COUNTED_FROM: Final[Mapping[str, str]] = {"evt3": "", "dsec": ", as their t_offset says"}
"""Formats whose times count from the start of the exported part, and where the files say so."""
LOOK_US: Final = 100_000


def time_note(format_name: str, recording: Recording, span: Span) -> str:
    """How times in the exported files relate to the recording's; empty for formats that keep them."""
    if format_name not in COUNTED_FROM:
        return ""
    counted = f"Times in the files count from {span.start_us} us of the recording{COUNTED_FROM[format_name]}."
    first_us = _first_event_us(recording, span)
    if first_us is None:
        return counted
    return f"{counted} Imported again, time 0 is the first event: add {first_us} us to get the recording's times."


def _first_event_us(recording: Recording, span: Span) -> int | None:
    """Time of the first event of all cameras in a part of a recording; None if it has none."""
    for start_us in range(span.start_us, span.end_us, LOOK_US):
        parts = [one.slice(start_us, min(start_us + LOOK_US, span.end_us)) for one in recording.cameras.values()]
        firsts = [int(events.t_us[0]) for events in parts if len(events)]
        if firsts:
            return min(firsts)
    return None


# Formats are imported on first use: each has its own dependencies.


def _rrd(task: ExportTask) -> tuple[Path, ...]:
    require_package("rerun", "a Rerun recording")
    from app.export.rrd.recording import export_rrd

    return export_rrd(task)


def _csv(task: ExportTask) -> tuple[Path, ...]:
    require_package("pyarrow", "an export of tables")
    from app.export.events import export_csv

    return export_csv(task)


def _dsec(task: ExportTask) -> tuple[Path, ...]:
    from app.export.events import export_dsec

    return export_dsec(task)


def _evt3(task: ExportTask) -> tuple[Path, ...]:
    from app.export.events import export_evt3

    return export_evt3(task)


def _mcap(task: ExportTask) -> tuple[Path, ...]:
    from app.export.ros.recording import export_mcap

    return export_mcap(task)


def _rosbag(task: ExportTask) -> tuple[Path, ...]:
    from app.export.ros.recording import export_rosbag

    return export_rosbag(task)


def _film(task: ExportTask) -> tuple[Path, ...]:
    from app.export.scenes.drawn_picture import export_mp4

    return export_mp4(task)


def _still(task: ExportTask) -> tuple[Path, ...]:
    from app.export.scenes.drawn_picture import export_png

    return export_png(task)


def _scene(task: ExportTask) -> tuple[Path, ...]:
    from app.export.scenes.scene_file import export_scene

    return export_scene(task)


def _actor_of_run(task: RunTask) -> tuple[Path, ...]:
    try:
        from app.export.onnx_actor import export_actor
    except ImportError as error:
        raise CommandError("an ONNX file needs onnx", remedy="pip install 'rallyscope[onnx]'") from error
    return export_actor(task)


def _film_of_run(task: RunTask) -> tuple[Path, ...]:
    from app.export.scenes.training_film import export_training_film

    return export_training_film(task)


def _rrd_of_run(task: RunTask) -> tuple[Path, ...]:
    require_package("rerun", "a Rerun recording")
    from app.export.rrd.run import export_run

    return export_run(task)


register_exporter(
    "rrd", _rrd, "Rerun (.rrd)", ".rrd", export_run=_rrd_of_run, computed=True,
    what="a Rerun recording: 3D, pictures with the detector's stages, curves",
)  # fmt: skip
register_exporter(
    "html", _scene, "3D scene as a web page (.html)", ".html", computed=True,
    what="the 3D scene with playback as one web page",
)  # fmt: skip
register_exporter(
    "viser", _scene, "3D scene for viser (.viser)", ".viser", computed=True,
    what="the 3D scene with playback for viser's own player",
)  # fmt: skip
register_exporter(
    "mp4", _film, "Film with both cameras, drawn by the server (.mp4)", ".mp4", export_run=_film_of_run, computed=True,
    what="a film: 3D drawing and event pictures; of a training run every 10th ball",
)  # fmt: skip
register_exporter(
    "png", _still, "Picture with both cameras, at the end of the part (.png)", ".png", computed=True,
    what="a picture of the end of the part: 3D drawing and event pictures",
)  # fmt: skip
register_exporter("dsec", _dsec, "DSEC (HDF5 per camera)", what="event files in DSEC's HDF5 layout, one per camera")
register_exporter("evt3", _evt3, "Prophesee RAW (EVT3)", what="Prophesee RAW files (EVT3), one per camera")
register_exporter(
    "mcap", _mcap, "MCAP for Foxglove (.mcap)", ".mcap", computed=True,
    what="an MCAP file for Foxglove: events, pictures, detections and 3D as ROS 2 messages",
)  # fmt: skip
register_exporter(
    "rosbag", _rosbag, "ROS 2 bag of the events", what="a ROS 2 bag: events as EventPackets (EVT3) and calibration"
)
register_exporter("csv", _csv, "CSV tables", what="events, truth and the chain's columns as tables")
register_exporter(
    "onnx", None, "", ".onnx", export_run=_actor_of_run, what="the actor of a training run as an ONNX graph"
)
FORMATS.mark_built_in()
