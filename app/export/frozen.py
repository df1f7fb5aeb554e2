"""A span of a live rally copied to memory, so that it does not change while it is exported or saved."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from app.export.events import event_slices, share_of
from app.export.selection import Span
from app.export.unfinished import Cancelled, Progress, check_cancelled
from core.errors import RecordingError
from core.events import CameraFrame
from core.files import replacing
from core.recordings import BallTruth, CameraStream, PixelTruth, Recording, RecordingWriter
from core.recordings.frames import FrameStream, frames_in_memory, frames_of
from core.recordings.reader import FileRecording
from core.recordings.recording import FrozenCamera, freeze_camera


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSnapshot:
    """A Recording in memory, with the clock of its source."""

    uuid: str
    duration_us: int
    streams: dict[str, FrozenCamera]
    ball: BallTruth | None
    notes: tuple[str, ...]
    frames: dict[str, FrameStream] = field(default_factory=dict)
    """Pictures of ordinary cameras, of a live rally only: those of a file can be read again."""

    @property
    def cameras(self) -> dict[str, CameraStream]:
        """All cameras of the snapshot by name."""
        return dict(self.streams)

    def close(self) -> None:
        """Do nothing: a snapshot holds no file."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def freeze(recording: Recording, span: Span) -> RecordingSnapshot:
    """Copy a span of a recording.

    Raises:
        RecordingError: if another session of the simulation began meanwhile.
    """
    uuid = recording.uuid
    streams = {name: freeze_camera(one, span.start_us, span.end_us) for name, one in recording.cameras.items()}
    is_file = isinstance(recording, FileRecording)
    frames = {} if is_file else {name: _held(one, span) for name, one in frames_of(recording).items()}
    frozen = RecordingSnapshot(uuid, span.end_us, streams, recording.ball, recording.notes, frames)
    if recording.uuid != uuid:
        raise RecordingError("the live rally began anew while it was frozen", remedy="do it again")
    return frozen


def _held(stream: FrameStream, span: Span) -> FrameStream:
    """The pictures whose exposure ends in a span, held in memory; the oldest may be forgotten meanwhile."""
    held: list[CameraFrame] = []
    for number in stream.ending_within(span.start_us, span.end_us):
        with contextlib.suppress(RecordingError):
            held.append(stream.frame(number))
    return frames_in_memory(held, stream.calibration)


def write_frozen(
    frozen: RecordingSnapshot,
    span: Span,
    path: Path,
    *,
    progress: Progress,
    cancelled: Cancelled,
    config: Mapping[str, object] | None = None,
    uuid: str | None = None,
) -> str:
    """Write the events, pictures, calibrations and truth of a span to a recording whose time begins at 0; its identity.

    Args:
        frozen: what is written.
        span: of its clock.
        path: the file.
        progress: gets the share that is written.
        cancelled: looked at between slices.
        config: says where it is from; None: from the live rally.
        uuid: its identity; None: a new one.

    Raises:
        RecordingError: if it cannot be written.
        ExportCancelledError: if `cancelled()` is true; nothing is left behind then.
    """
    frames = {name: one for name, one in frozen.frames.items() if len(one)}
    sensors = {name: stream.sensor for name, stream in frozen.streams.items()}
    sensors |= {name: one.sensor for name, one in frames.items() if name not in sensors}
    known = {name: one.calibration for name, one in (frames | frozen.streams).items()}
    calibration = {name: camera for name, camera in known.items() if camera is not None}
    config = config or {"source": "live rally, frozen", "session": frozen.uuid}
    with replacing(path, durable=True) as partial:
        with RecordingWriter(partial, sensors, calibration=calibration, config=config, uuid=uuid) as writer:
            for number, (name, stream) in enumerate(frozen.streams.items()):
                share = share_of(number, len(frozen.streams), progress)
                for events in event_slices(stream, span, share, cancelled):
                    writer.append(name, events)
                if stream.truth is not None:
                    writer.write_truth(name, _pixel_truth_within(stream.truth, span))
            for name, stream in frames.items():
                for number in range(len(stream)):
                    check_cancelled(cancelled)
                    writer.write_frame(name, stream.frame(number), span.start_us)
            if frozen.ball is not None:
                writer.write_ball(_ball_within(frozen.ball, span))
            writer.extend_duration(span.length_us)
        return writer.uuid


def _pixel_truth_within(truth: PixelTruth, span: Span) -> PixelTruth:
    rows = (truth.t_us >= span.start_us) & (truth.t_us < span.end_us)
    return PixelTruth(
        truth.t_us[rows] - span.start_us, truth.u_px[rows], truth.v_px[rows], truth.r_px[rows], truth.visible[rows]
    )


def _ball_within(ball: BallTruth, span: Span) -> BallTruth:
    rows = (ball.t_us >= span.start_us) & (ball.t_us < span.end_us)
    return BallTruth(
        ball.t_us[rows] - span.start_us,
        ball.p_world_m[rows],
        ball.v_world_mps[rows],
        ball.spin_radps[rows],
        ball.visible[rows],
    )
