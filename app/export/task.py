"""What is to be exported, how, and who waits for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress
from core.chain import ChainConfig
from core.recordings import Recording
from core.recordings.layout import Rows
from labels.arrays import LabelArrays


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportRequest:
    """A requested export."""

    format: str
    destination: Path
    start_us: int | None = None
    end_us: int | None = None
    stride_us: int | None = None
    """Time between two pictures; None: the format's default."""
    pictures: bool = True
    stages: bool = True
    plots: bool = True
    chain: ChainConfig = field(default_factory=ChainConfig)
    overwrite: bool = False
    seed: int | None = None
    """Seed of a run whose actor or film is exported; None: its first."""
    policy: Literal["last", "best"] = "last"


@dataclass(frozen=True, slots=True, eq=False)
class ExportTask:
    """Export of a recording, with everything it needs: what every exporter is given.

    An exporter raises CommandError if a file exists and `overwrite` is not set, or it cannot be written, and
    ExportCancelledError once `cancelled()` is true; there is no file then.
    """

    order: ExportRequest
    recording: Recording
    span: Span
    groups: Callable[[str], Rows | None] = lambda group: None
    """Rows of a group of the recording's file, such as `predictions`; None if it has none."""
    labels: Mapping[str, LabelArrays] = field(default_factory=dict)
    progress: Progress = lambda share: None
    cancelled: Cancelled = lambda: False

    @property
    def path(self) -> Path:
        """Where the result goes."""
        return self.order.destination


@dataclass(frozen=True, slots=True, eq=False)
class RunTask:
    """Export of a training run, with everything it needs; errors are as those of an `ExportTask`."""

    order: ExportRequest
    run: Path
    progress: Progress = lambda share: None
    cancelled: Cancelled = lambda: False

    @property
    def path(self) -> Path:
        """Where the result goes."""
        return self.order.destination
