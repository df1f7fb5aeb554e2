"""What is sent to a Rerun viewer: the part of a recording that would be exported, or the live rally from now on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

from app.export.selection import span_of
from app.export.unfinished import Cancelled, Progress
from app.modes.export.plan_panel import ExportPlan
from app.shared.live_rally import LiveRally
from core.chain import ChainConfig
from core.detection.saved import SavedDetector
from core.errors import CommandError
from core.extras import require_package
from core.live.ring_recording import RingRecording
from core.recordings import Recording
from core.recordings.layout import Rows
from labels.arrays import LabelArrays
from labels.store import LabelStore, find_layers


@dataclass(frozen=True, slots=True, eq=False)
class StreamOrder:
    """Everything that a stream takes."""

    address: str
    name: str
    recording: Recording
    plan: ExportPlan
    detector: SavedDetector
    labels: Path
    """The folder of all labels."""
    live: LiveRally | None

    def check(self) -> None:
        """Say at once what is wrong with it.

        Raises:
            CommandError: if it cannot be sent.
        """
        if self.plan.what != "Recording":
            raise CommandError("a training run is not streamed", remedy="export it, and open the file in Rerun")
        if not isinstance(self.recording, RingRecording):
            span_of(self.recording, self.plan.start_us, self.plan.end_us)

    def send(self, progress: Progress, cancelled: Cancelled, remark: Callable[[str], None]) -> None:
        """Send it; a live rally until it is cancelled.

        Raises:
            RallyscopeError: if there is no viewer, or it is lost.
            ExportCancelledError: if `cancelled()` is true.
        """
        require_package("rerun", "a stream to a Rerun viewer")
        from app.export.rrd.recording import RrdContents  # Rerun is loaded when it is wanted
        from app.export.rrd.viewer import stream_live, stream_recording

        plan, recording = self.plan, self.recording
        contents = RrdContents(
            chain=ChainConfig.of_method(*self.detector),
            stride_us=plan.stride_us,
            pictures=plan.pictures,
            stages=plan.stages,
            plots=plan.plots,
            labels=labels_of(self.labels, recording.uuid, plan.annotator),
        )
        groups = groups_of(recording, self.live)
        if isinstance(recording, RingRecording):
            with nullcontext() if self.live is None else self.live.kept_awake():
                stream_live(
                    recording, self.address, contents, name=self.name, groups=groups, cancelled=cancelled,
                    skipped=lambda us: remark(f"{us / 1e6:.1f} s were skipped: this machine is too slow"),
                )  # fmt: skip
            return
        span = span_of(recording, plan.start_us, plan.end_us)
        stream_recording(
            recording, self.address, span, contents, name=self.name, groups=groups, progress=progress,
            cancelled=cancelled,
        )  # fmt: skip


def groups_of(recording: Recording, live: LiveRally | None) -> Callable[[str], Rows | None]:
    """What reads the further groups of a recording, such as "/racket"."""
    if isinstance(recording, RingRecording):
        return live.rows.read_rows if live is not None and live.recording is recording else _no_rows
    return getattr(recording, "read_rows", _no_rows)


def labels_of(folder: Path, recording_uuid: str, annotator: str | None) -> dict[str, LabelArrays]:
    """An annotator's labels by camera."""
    mine = [layer for layer in find_layers(folder, recording_uuid) if layer.annotator == annotator]
    return {layer.camera: LabelStore.read(folder, layer).labels() for layer in mine if not layer.blind}


def _no_rows(group: str) -> Rows | None:
    """What a recording without groups gives: no rows."""
    return None
