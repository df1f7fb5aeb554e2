"""A recording as a Rerun file: the rally in 3D, what each camera saw and the detector made of it, and curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from app.export.rrd import blueprint as rrd_blueprint
from app.export.rrd import camera as rrd_camera
from app.export.rrd import rally as rrd_rally
from app.export.rrd.blueprint import recording_blueprint
from app.export.rrd.camera import CameraPicture, PictureJob, PicturePool
from app.export.rrd.paths import picture_path, rerun_file
from app.export.rrd.rally import log_arena, log_cameras
from app.export.selection import DEFAULT_STRIDE_US, Span
from app.export.steps import ChainFollower, ChainStep, window_length_us
from app.export.task import ExportTask
from app.export.unfinished import Cancelled, Progress, check_cancelled
from core.chain import ChainConfig
from core.chain.follow import frame_cameras
from core.detection import TrackState
from core.detection.methods import STAGED, method_config
from core.history.following import is_stereo
from core.recordings import Recording
from core.recordings.frames import FrameStream
from core.recordings.layout import Rows
from labels.arrays import LabelArrays

STEPS_PER_PART = 512
"""Windows per part sent to Rerun, about a second."""
SHARE_OF_STEPS = 0.95
"""Share of the time that the steps take; the rest is optimizing the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RrdContents:
    """Contents of the file."""

    chain: ChainConfig = field(default_factory=ChainConfig)
    stride_us: int = DEFAULT_STRIDE_US
    """Time between two pictures; rounded to whole windows of the detector."""
    pictures: bool = True
    stages: bool = True
    """Whether the pictures show the results of each stage of the detector."""
    plots: bool = True
    labels: Mapping[str, LabelArrays] = field(default_factory=dict)
    """Labels by camera."""


def contents_of(task: ExportTask) -> RrdContents:
    """The contents that a task asks for."""
    order = task.order
    return RrdContents(
        chain=order.chain, stride_us=order.stride_us or DEFAULT_STRIDE_US, pictures=order.pictures,
        stages=order.stages, plots=order.plots, labels=task.labels,
    )  # fmt: skip


def export_rrd(task: ExportTask) -> tuple[Path, ...]:
    """Write the file."""
    recording, span, contents = task.recording, task.span, contents_of(task)
    # The same part again gives the same identity: the viewer replaces it.
    name = f"{recording.uuid}-{span.start_us}-{span.end_us}"
    blueprint = blueprint_of(recording, contents, task.groups)
    with rerun_file(
        task.path, blueprint, recording_id=name, overwrite=task.order.overwrite, cancelled=task.cancelled
    ) as stream:
        writer = RallyWriter(stream, recording, contents, task.groups)
        writer.begin()
        with PicturePool(writer.pictures_of(span)) as pool:
            writer.write(recording, span, pool, lambda share: task.progress(SHARE_OF_STEPS * share), task.cancelled)
    task.progress(1.0)
    return (task.path,)


def blueprint_of(recording: Recording, contents: RrdContents, groups: Callable[[str], Rows | None]) -> rrb.Blueprint:
    """Layout of the recording in a viewer."""
    cameras = {name: one.calibration is not None for name, one in recording.cameras.items()}
    cameras |= dict.fromkeys(_frames_of(recording, contents), True)
    return recording_blueprint(cameras, rewards=contents.plots and groups("/episodes") is not None)


def _frames_of(recording: Recording, contents: RrdContents) -> dict[str, FrameStream]:
    """Frame cameras whose pictures are written: they have a place in 3D, beside that of the event cameras."""
    return frame_cameras(recording) if contents.pictures and is_stereo(recording) else {}


class RallyWriter:
    """Writes one rally to a stream, span by span."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        recording: Recording,
        contents: RrdContents,
        groups: Callable[[str], Rows | None],
        *,
        written: Callable[[], None] = lambda: None,
    ) -> None:
        """`recording` says which cameras there are; `written` is called after every part of about a second."""
        self._stream, self._contents, self._groups, self._written = stream, contents, groups, written
        self._cameras = {name: one.calibration for name, one in recording.cameras.items()}
        self._paths = {
            name: picture_path(name, calibrated=camera is not None) for name, camera in self._cameras.items()
        }
        frames = _frames_of(recording, contents)
        self._frame_cameras = {name: one.calibration for name, one in frames.items()}
        self._detector = method_config(contents.chain.method, contents.chain.detector)
        self._stages = contents.stages and contents.chain.method in STAGED
        self._window_us = window_length_us(contents.chain)
        self._every = max(1, round(contents.stride_us / self._window_us))
        self._chain = ChainFollower(recording, contents.chain, picture_every=self._every)
        self._steps: list[ChainStep] = []
        self._pictures: dict[str, list[CameraPicture]] = {name: [] for name in self._cameras}

    def pictures_of(self, span: Span) -> int:
        """Approximate number of pictures in a span."""
        return len(self._paths) * span.length_us // (self._every * self._window_us) if self._contents.pictures else 0

    def begin(self) -> None:
        """Write the static entities."""
        if any(camera is not None for camera in self._cameras.values()):
            log_arena(self._stream, self._contents.chain.predictor.hit_x_m)
        log_cameras(self._stream, self._cameras | self._frame_cameras)
        if self._contents.plots:
            rrd_blueprint.log_styles(self._stream, list(self._cameras))

    def write(
        self, recording: Recording, span: Span, pool: PicturePool, progress: Progress, cancelled: Cancelled
    ) -> None:
        """Write a span, which begins where the one before it ended."""
        self._write_rows(recording, span)
        for step in self._chain.follow(recording, span):
            check_cancelled(cancelled)
            self._take(step, pool)
            if len(self._steps) >= STEPS_PER_PART:
                self._write_part(recording, pool, everything=False)
                progress((step.end_us - span.start_us) / span.length_us)
        self._write_part(recording, pool, everything=True)

    def _write_rows(self, recording: Recording, span: Span) -> None:
        """Write what is known of the span without the chain."""
        stream = self._stream
        if recording.ball is not None:
            first, last = np.searchsorted(recording.ball.t_us, (span.start_us, span.end_us))
            if last > first:
                rrd_rally.send_ball_truth(stream, recording.ball, slice(int(first), int(last)))
        senders = [
            ("/racket", "t_us", rrd_rally.send_racket),
            ("/racket_targets", "t_us", rrd_rally.send_racket_targets),
            ("/predictions", "t_us", rrd_rally.send_recorded_predictions),
            ("/hit_choices", "t_us", rrd_rally.send_hit_choices),
            ("/episodes", "serve_us", rrd_rally.send_episodes),
        ]
        if self._contents.plots:
            senders.append(("/episodes", "serve_us", rrd_blueprint.send_rewards))
        for group, clock, write in senders:
            rows = self._groups(group)
            if rows is not None:
                inside = (span.start_us <= rows[clock]) & (rows[clock] < span.end_us)
                if inside.any():
                    write(stream, {name: column[inside] for name, column in rows.items()})
        if self._contents.plots:
            rrd_blueprint.send_rates(stream, recording, span)
        for name, frames in _frames_of(recording, self._contents).items():
            path = picture_path(name, calibrated=True)
            rrd_camera.send_frames(stream, path, frames, frames.of_span(span.start_us, span.end_us))
        for name, labels in self._contents.labels.items():
            placed = labels.between(span.start_us, span.end_us)
            rrd_camera.send_labels(stream, self._paths[name], placed, self._contents.stride_us)

    def _take(self, step: ChainStep, pool: PicturePool) -> None:
        self._steps.append(step)
        if step.before is not None and self._contents.pictures:
            for name, window in step.windows.items():
                before = step.before.get(name, TrackState())
                pool.submit(name, PictureJob(window, before, self._detector, self._stages))

    def _write_part(self, recording: Recording, pool: PicturePool, *, everything: bool) -> None:
        steps, self._steps = self._steps, []
        if steps:
            self._write_steps(recording, steps)
        for name, picture in pool.ready(everything=everything):
            self._pictures[name].append(picture)
        for name, pictures in self._pictures.items():
            if pictures:
                rrd_camera.send_pictures(self._stream, self._paths[name], pictures, stages=self._stages)
                self._pictures[name] = []
        self._written()

    def _write_steps(self, recording: Recording, steps: list[ChainStep]) -> None:
        stream = self._stream
        times = [step.end_us for step in steps]
        if is_stereo(recording):
            chains = [step.chain for step in steps if step.chain is not None]
            named = len(recording.cameras) > 2  # of two cameras, both place the ball, always
            rrd_rally.send_ball(stream, times, [one.point for one in chains], cameras=named)
            ticks = [(step.end_us, step.chain) for step in steps if step.before is not None and step.chain is not None]
            predictions = [chain.prediction for _, chain in ticks]
            cameras = [chain.predicted_from for _, chain in ticks] if named else None
            rrd_rally.send_predictions(stream, [end_us for end_us, _ in ticks], predictions, cameras)
        for name, camera in recording.cameras.items():
            found = [step.detections[name] for step in steps]
            rrd_camera.send_detections(stream, self._paths[name], times, found)
            if camera.truth is not None:
                rrd_camera.send_truth(stream, self._paths[name], camera.truth, np.array(times))
        if self._contents.plots:
            rrd_blueprint.send_step_curves(stream, recording, steps)
