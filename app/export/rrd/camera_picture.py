"""One window of one camera for Rerun: the picture, and the results of each stage of the detector."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from app.export.small_png import polarity_png
from core.detection import DetectorConfig, PipelineTrace, TrackState, trace_window
from core.detection.fast.cluster import grid_labels
from core.detection.stages.roi import Roi
from core.events import Window, polarity_image


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
