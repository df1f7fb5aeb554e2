"""Rerun entities of one camera: pictures, stages of the detector, detections, truth and labels.

Pictures are made beside the chain: in other processes where there are many, because most of the work is Python.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from enum import IntEnum
from types import TracebackType
from typing import Final, Self

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from app.export.rrd.paths import HALF_PIXEL, lengths_of, send, stacked, time_column
from app.export.selection import polarity_png
from core.detection import Detection, DetectorConfig, PipelineTrace, TrackState, trace_window
from core.detection.fast.cluster import grid_labels
from core.detection.stages.roi import Roi
from core.events import Window, polarity_image
from core.files import end_with_parent
from core.recordings import PixelTruth
from core.recordings.frames import FrameStream
from core.registry import load_plugin_files
from labels.arrays import LabelArrays


class EventStage(IntEnum):
    """Last stage that an event passed after denoising."""

    DENOISED = 1
    """In no cluster."""
    REJECTED = 2
    """In a cluster that was rejected."""
    TRAILING = 3
    """Palette index of events of the ball that are not on its leading edge."""
    LEADING = 4
    """Palette index of events on the ball's leading edge; the circle encloses these."""


EVENT_STAGE_NAMES = {
    EventStage.DENOISED: "denoised, no cluster",
    EventStage.REJECTED: "cluster, rejected",
    EventStage.TRAILING: "ball",
    EventStage.LEADING: "ball, leading edge",
}


@dataclass(frozen=True, slots=True, eq=False)
class PictureJob:
    """Input of a picture, small enough to send to another process."""

    window: Window
    before: TrackState
    config: DetectorConfig
    stages: bool


@dataclass(frozen=True, slots=True, eq=False)
class CameraPicture:
    """Pixel coordinates are event addresses: (0.0, 0.0) is the centre of the first pixel."""

    t_us: int
    """End of the window."""
    png: bytes
    events_px: NDArray[np.float32]
    """(N, 2) events left after denoising."""
    event_stages: NDArray[np.uint16]
    """(N,) values of `EventStage`."""
    hulls_px: tuple[NDArray[np.float32], ...]
    """Closed outlines (K, 2) of the clusters that were measured."""
    accepted: tuple[bool, ...]
    """Whether each of them was accepted."""
    roi: Roi | None


def make_picture(job: PictureJob) -> CameraPicture:
    """Draw one window and run the detector on it."""
    window = job.window
    png = polarity_png(polarity_image(window.events))
    if not job.stages:
        return CameraPicture(window.end_us, png, np.empty((0, 2), np.float32), np.empty(0, np.uint16), (), (), None)
    trace = trace_window(window, job.before, job.config, label_clusters=grid_labels)
    clean = trace.stage("denoise").events
    shapes = [(one.shape.hull_px, one.rejected is None) for one in trace.candidates if one.shape is not None]
    shapes = [(hull, accepted) for hull, accepted in shapes if len(hull) > 2]
    return CameraPicture(
        window.end_us,
        png,
        np.column_stack([clean.x_px, clean.y_px]).astype(np.float32),
        _event_stages(trace),
        tuple(np.concatenate([hull, hull[:1]]).astype(np.float32) for hull, _ in shapes),
        tuple(accepted for _, accepted in shapes),
        trace.roi,
    )


def _event_stages(trace: PipelineTrace) -> NDArray[np.uint16]:
    event_stages = np.full(len(trace.labels), EventStage.DENOISED, np.uint16)
    event_stages[trace.labels >= 0] = EventStage.REJECTED
    for one in trace.candidates:
        if one.rejected is None:
            event_stages[one.rows] = EventStage.TRAILING
            event_stages[one.leading_rows] = EventStage.LEADING
    return event_stages


WORKERS: Final = min(2, os.cpu_count() or 1)
WORTH_PROCESSES: Final = 1000
"""Fewer pictures than this are made before a new process has loaded its libraries."""
WAITING: Final = 128
"""Batches on their way at a time: bounds the memory."""
BATCH: Final = 16


class PicturePool:
    """Takes jobs in order and gives pictures back in the same order, under the key they were given with."""

    def __init__(self, expected: int) -> None:
        """For about `expected` pictures."""
        self._executor: Executor
        if expected >= WORTH_PROCESSES:
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(WORKERS, mp_context=context, initializer=_start_process)
        else:
            self._executor = ThreadPoolExecutor(1, thread_name_prefix="export-picture")
        self._pending: deque[tuple[list[str], Future[list[CameraPicture]]]] = deque()
        self._keys: list[str] = []
        self._jobs: list[PictureJob] = []

    def submit(self, key: str, job: PictureJob) -> None:
        """Add a picture to make."""
        self._keys.append(key)
        self._jobs.append(job)
        if len(self._jobs) >= BATCH:
            self._send()

    def ready(self, *, everything: bool = False) -> list[tuple[str, CameraPicture]]:
        """The pictures that are made, by camera, in the order of their jobs; with `everything`, wait for all."""
        if everything and self._jobs:
            self._send()
        found: list[tuple[str, CameraPicture]] = []
        while self._pending and (everything or len(self._pending) > WAITING or self._pending[0][1].done()):
            keys, future = self._pending.popleft()
            found += zip(keys, future.result(), strict=True)
        return found

    def _send(self) -> None:
        self._pending.append((self._keys, self._executor.submit(_make, self._jobs)))
        self._keys, self._jobs = [], []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)


def _start_process() -> None:
    end_with_parent()
    load_plugin_files()  # a job holds a config, which may have a plugin's section


def _make(jobs: list[PictureJob]) -> list[CameraPicture]:
    return [make_picture(job) for job in jobs]


DETECTION_RGB = (255, 225, 60)
TRUTH_RGB = (60, 230, 230)
LABEL_RGB = (255, 90, 220)
HULL_RGB = (165, 225, 40)
REJECTED_RGB = (150, 105, 105)
ROI_RGB = (200, 120, 255)
JPEG_QUALITY: Final = 90
"""Quality of frame cameras' pictures. Lossless codes keep their noise: a simulated one has 44 KB, as PNG 348."""
ARC = np.linspace(0, 2 * np.pi, 33)
CIRCLE = np.column_stack([np.cos(ARC), np.sin(ARC)])


def send_pictures(stream: rr.RecordingStream, path: str, pictures: Sequence[CameraPicture], *, stages: bool) -> None:
    """Send pictures in order of time, with each stage of the detector as a layer of its own."""
    times = time_column([one.t_us for one in pictures])
    image = rr.EncodedImage.columns(blob=[one.png for one in pictures], media_type=["image/png"] * len(pictures))
    send(stream, path, times, image)
    if not stages:
        return
    points = stacked([one.events_px + HALF_PIXEL for one in pictures], 2)
    event_stages = np.concatenate([one.event_stages for one in pictures])
    columns = rr.Points2D.columns(positions=points, class_ids=event_stages, radii=np.full(len(points), 0.5))
    send(stream, f"{path}/stages/events", times, columns.partition(lengths_of([one.event_stages for one in pictures])))
    hulls = [hull + HALF_PIXEL for one in pictures for hull in one.hulls_px]
    colours = [HULL_RGB if accepted else REJECTED_RGB for one in pictures for accepted in one.accepted]
    hull_rows = lengths_of([one.hulls_px for one in pictures])
    if hulls:
        lines = rr.LineStrips2D.columns(strips=hulls, colors=colours)
        send(stream, f"{path}/stages/hulls", times, lines.partition(hull_rows))
    rois = [one.roi for one in pictures if one.roi is not None]
    if rois:
        low = np.array([(roi.x_min, roi.y_min) for roi in rois], np.float64)
        high = np.array([(roi.x_max + 1, roi.y_max + 1) for roi in rois], np.float64)
        boxes = rr.Boxes2D.columns(centers=(low + high) / 2, half_sizes=(high - low) / 2, colors=[ROI_RGB] * len(rois))
        send(stream, f"{path}/stages/roi", times, boxes.partition([one.roi is not None for one in pictures]))


def send_frames(stream: rr.RecordingStream, path: str, frames: FrameStream, numbers: range) -> None:
    """Send some pictures of a frame camera, each at its mid exposure.

    Raises:
        RecordingError: if one is damaged.
    """
    for number in numbers:
        image = frames.image(number)
        bgr = image if image.ndim == 2 else image[:, :, ::-1]
        fine, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        assert fine
        columns = rr.EncodedImage.columns(blob=[jpeg.tobytes()], media_type=["image/jpeg"])
        send(stream, path, time_column(frames.t_us[number : number + 1]), columns)


def send_detections(
    stream: rr.RecordingStream, path: str, t_us: Sequence[int], found: Sequence[Detection | None]
) -> None:
    """Send a row per window: the circle, or nothing."""
    rows = [None if one is None else (one.u_px, one.v_px, one.r_px) for one in found]
    _send_circles(stream, f"{path}/detection", t_us, rows, DETECTION_RGB)


def send_truth(stream: rr.RecordingStream, path: str, truth: PixelTruth, t_us: NDArray[np.int64]) -> None:
    """Send the true outline at given times.

    Args:
        stream: where it goes.
        path: entity of the camera.
        truth: of that camera.
        t_us: (N,) times at which it is sent.
    """
    now = truth.at(t_us)
    columns = zip(now.u_px.tolist(), now.v_px.tolist(), now.r_px.tolist(), now.visible.tolist(), strict=True)
    rows = [(u, v, r) if visible else None for u, v, r, visible in columns]
    _send_circles(stream, f"{path}/truth", t_us, rows, TRUTH_RGB)


def send_labels(stream: rr.RecordingStream, path: str, labels: LabelArrays, hold_us: int) -> None:
    """Send labels, each shown for `hold_us` from its time on.

    Args:
        stream: where they go.
        path: entity of the camera.
        labels: of that camera, in order of time.
        hold_us: how long each is shown.
    """
    placed = labels.rows(labels.seen & np.isfinite(labels.x_px))
    if not len(placed.t_us):
        return
    rows: dict[int, tuple[float, float, float] | None] = {}
    following = [*placed.t_us[1:].tolist(), np.inf]
    columns = (placed.t_us, placed.x_px, placed.y_px, placed.r_px)
    for t_us, x, y, r, next_us in zip(*(column.tolist() for column in columns), following, strict=True):
        rows[t_us] = (x, y, r if np.isfinite(r) else 1.0)
        if next_us > t_us + hold_us:
            rows[t_us + hold_us] = None
    times = sorted(rows)
    _send_circles(stream, f"{path}/label", times, [rows[t_us] for t_us in times], LABEL_RGB)


def _send_circles(
    stream: rr.RecordingStream,
    path: str,
    t_us: Sequence[int] | NDArray[np.int64],
    rows: Sequence[tuple[float, float, float] | None],
    colour: tuple[int, int, int],
) -> None:
    found = [row for row in rows if row is not None]
    if not found:
        return
    strips = [np.array([u, v]) + HALF_PIXEL + r * CIRCLE for u, v, r in found]
    lines = rr.LineStrips2D.columns(
        strips=strips, colors=[colour] * len(found), radii=[-1.5] * len(found)
    )  # a negative radius is one in points of the screen
    send(stream, path, time_column(t_us), lines.partition([row is not None for row in rows]))
