"""Export tasks as tests give them to an exporter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.export.selection import Span
from app.export.task import ExportRequest, ExportTask, RunTask
from core.recordings.reader import FileRecording


def task_of(
    recording: FileRecording,
    path: Path,
    span: Span,
    *,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
    **order: Any,
) -> ExportTask:
    """The export of a part of a recording to a path, with all its groups; `order` are fields of `ExportRequest`."""
    request = ExportRequest(**{"format": "", "destination": path, **order})
    return ExportTask(request, recording, span, recording.read_rows, progress=progress, cancelled=cancelled)


def run_task(
    run: Path,
    path: Path,
    *,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
    **order: Any,
) -> RunTask:
    """The export of a training run to a path; `order` are fields of `ExportRequest`."""
    return RunTask(ExportRequest(**{"format": "", "destination": path, **order}), run, progress, cancelled)
