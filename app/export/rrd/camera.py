"""Rerun entities of one camera: pictures, stages of the detector, detections, truth and labels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from app.export.rrd.camera_picture import CameraPicture
from app.export.rrd.paths import HALF_PIXEL, lengths_of, send, stacked, time_column
from core.detection import Detection
from core.recordings import PixelTruth
from labels.arrays import LabelArrays

DETECTION_RGB = (255, 225, 60)
TRUTH_RGB = (60, 230, 230)
LABEL_RGB = (255, 90, 220)
HULL_RGB = (165, 225, 40)
REJECTED_RGB = (150, 105, 105)
ROI_RGB = (200, 120, 255)
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


def send_detections(
    stream: rr.RecordingStream, path: str, t_us: Sequence[int], found: Sequence[Detection | None]
) -> None:
    """Send a row per window: the circle, or nothing."""
    rows = [None if one is None else (one.u_px, one.v_px, one.r_px) for one in found]
    _send_circles(stream, f"{path}/detection", t_us, rows, DETECTION_RGB)


def send_truth(stream: rr.RecordingStream, path: str, truth: PixelTruth, t_us: NDArray[np.int64]) -> None:
    """Send the true outline at given times."""
    now = truth.at(t_us)
    columns = zip(now.u_px.tolist(), now.v_px.tolist(), now.r_px.tolist(), now.visible.tolist(), strict=True)
    rows = [(u, v, r) if visible else None for u, v, r, visible in columns]
    _send_circles(stream, f"{path}/truth", t_us, rows, TRUTH_RGB)


def send_labels(stream: rr.RecordingStream, path: str, labels: LabelArrays, hold_us: int) -> None:
    """Send labels, each shown for `hold_us` from its time on."""
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
