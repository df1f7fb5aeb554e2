"""A recording as a ROS 2 bag of its events, or as an MCAP file of the whole rally.

Topics, by camera: /NAME/events (EventPacket, EVT3), /NAME/camera_info, and in MCAP /NAME/event_image/compressed (what
the events look like), /NAME/image/compressed (pictures of an ordinary camera), /NAME/detections (circles for Foxglove).
/tf_static tells where the cameras stand. In MCAP further: /ball (measured), /ball_true, /prediction, /racket, the names
of the cameras that a ball and a prediction are made from (/ball_cameras, /prediction_cameras), and the drawings
/ball_marker and /table.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from operator import itemgetter
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np

from app.export.events import check_evt3_sensors, event_slices
from app.export.ros import messages as ros
from app.export.ros.messages import BagFolder, McapFile, MessageFile, RosMessages
from app.export.selection import DEFAULT_STRIDE_US, Span, polarity_png
from app.export.steps import ChainFollower, window_length_us
from app.export.task import ExportTask
from app.export.unfinished import check_cancelled, unfinished_file, unfinished_folder
from core.chain import ChainConfig
from core.events import polarity_image
from core.recordings import CameraStream, Recording, calibrations_of
from core.recordings.evt3_encoder import Evt3Encoder
from core.recordings.frames import FrameStream, frames_of
from core.recordings.layout import Rows

PACKET_US: Final = 10_000
_INFO_US: Final = 1_000_000
"""Interval of repeated camera infos, for viewers that start in the middle."""
_LATEST_START_US: Final = 2**31 * 1_000_000 - 10**12
"""Latest start time: seconds of ROS have 31 bits."""


class _Message(NamedTuple):
    time_ns: int
    topic: str
    kind: str
    data: bytes


def export_rosbag(task: ExportTask) -> tuple[Path, ...]:
    """Write the events and the calibration as a bag of ROS 2; the task's path is the bag, a folder.

    Raises:
        CommandError: if a sensor is too large, or rosbags is missing.
    """
    messages, folder = RosMessages(), task.path
    _check_lenses(task.recording)
    streams = [_calibration(task.recording, task.span, messages), *_events(task.recording, task.span, messages)]
    names = ["metadata.yaml", f"{folder.name}.db3"]
    with unfinished_folder(folder, names, overwrite=task.order.overwrite) as unfinished:
        bag = unfinished / folder.name
        with BagFolder(bag, messages) as file:
            _write(file, streams, task)
        # The bag is written as a folder of its own name, whose files then stand in the one that appears at once.
        for name in names:
            (bag / name).rename(unfinished / name)
    return tuple(folder / name for name in names)


def export_mcap(task: ExportTask) -> tuple[Path, ...]:
    """Write events, pictures, detections and everything in 3D.

    Raises:
        CommandError: if a sensor is too large, or a library is missing.
    """
    recording, span, messages = task.recording, task.span, RosMessages()
    _check_lenses(recording)
    streams: list[Iterable[_Message]] = [
        _calibration(recording, span, messages),
        *_events(recording, span, messages),
        _chain(recording, span, task.order.chain, task.order.stride_us or DEFAULT_STRIDE_US, messages),
        _truth(recording, span, messages),
        _racket(recording, span, task.groups("/racket"), messages),
        *_pictures(recording, span, messages),
    ]
    with (
        unfinished_file(task.path, overwrite=task.order.overwrite) as unfinished,
        McapFile(unfinished, messages) as file,
    ):
        _write(file, streams, task)
    return (task.path,)


def clock_us(recording: Recording) -> int:
    """Offset from recording times to message times: the cameras' common clock, else 0."""
    offsets = {int(getattr(stream, "t_offset_us", 0)) for stream in recording.cameras.values()}
    offset = offsets.pop() if len(offsets) == 1 else 0
    return offset if 0 <= offset < _LATEST_START_US else 0


def _write(file: MessageFile, streams: list[Iterable[_Message]], task: ExportTask) -> None:
    start_ns = 1000 * (task.span.start_us + clock_us(task.recording))
    for number, message in enumerate(heapq.merge(*streams, key=itemgetter(0))):
        if number % 256 == 0:
            check_cancelled(task.cancelled)
            task.progress(min(0.99, max(0.0, (message.time_ns - start_ns) / (1000 * task.span.length_us))))
        file.add(message.topic, message.kind, message.time_ns, message.data)
    task.progress(1.0)


def _check_lenses(recording: Recording) -> None:
    """Raises CommandError, before anything is written, for a lens that ROS has no name for."""
    for camera in calibrations_of(recording).values():
        ros.distortion_model(camera)


def _calibration(recording: Recording, span: Span, messages: RosMessages) -> Iterator[_Message]:
    cameras, clock = calibrations_of(recording), clock_us(recording)
    if not cameras:
        return
    start_ns = 1000 * (span.start_us + clock)
    yield _Message(start_ns, "/tf_static", ros.TRANSFORMS, messages.poses_of_cameras(start_ns, cameras))
    for at_us in range(span.start_us, span.end_us, _INFO_US):
        time_ns = 1000 * (at_us + clock)
        for name, camera in cameras.items():
            data = messages.camera_info(time_ns, name, camera)
            yield _Message(time_ns, f"/{name}/camera_info", ros.CAMERA_INFO, data)


def _events(recording: Recording, span: Span, messages: RosMessages) -> list[Iterable[_Message]]:
    check_evt3_sensors(recording)
    return [_packets(name, stream, span, clock_us(recording), messages) for name, stream in recording.cameras.items()]


def _packets(name: str, stream: CameraStream, span: Span, clock: int, messages: RosMessages) -> Iterator[_Message]:
    """Packets of up to 10 ms; the stamp of each is the time of its first event."""
    encoder, number = Evt3Encoder(), 0
    size = stream.sensor.width_px, stream.sensor.height_px
    for events in event_slices(stream, span, lambda share: None, lambda: False):
        if not len(events):
            continue
        first, last = int(events.t_us[0]) // PACKET_US, int(events.t_us[-1]) // PACKET_US
        for packet in range(first, last + 1):
            part = events.between(packet * PACKET_US, (packet + 1) * PACKET_US)
            if not len(part):
                continue
            words = np.concatenate([encoder.begin_packet(), encoder.encode(part)])
            time_ns = 1000 * (int(part.t_us[0]) + span.start_us + clock)
            data = messages.events(time_ns, name, size, number, words)
            yield _Message(time_ns, f"/{name}/events", ros.EVENT_PACKET, data)
            number += 1


def _chain(
    recording: Recording, span: Span, config: ChainConfig, stride_us: int, messages: RosMessages
) -> Iterator[_Message]:
    """Messages of detectors and chain at the ends of their windows; pictures every `stride_us`."""
    clock = clock_us(recording)
    every = max(1, round(stride_us / window_length_us(config)))
    for step in ChainFollower(recording, config, picture_every=every).follow(recording, span):
        time_ns = 1000 * (step.end_us + clock)
        for name, found in step.detections.items():
            if found is not None:
                at_ns = 1000 * (found.t_us + clock)
                # Stamped with the ball's own time, logged at the window's end, when it became known.
                data = messages.circle(at_ns, found.u_px, found.v_px, found.r_px)
                yield _Message(time_ns, f"/{name}/detections", ros.ANNOTATIONS, data)
        if step.before is not None:
            for name, window in step.windows.items():
                png = polarity_png(polarity_image(window.events))
                data = messages.image(time_ns, name, png)
                yield _Message(time_ns, f"/{name}/event_image/compressed", ros.IMAGE, data)
        if step.chain is None:
            continue
        if step.chain.point is not None:
            point, at_ns = step.chain.point, 1000 * (step.chain.point.t_us + clock)
            yield _Message(time_ns, "/ball", ros.POINT, messages.point(at_ns, point.p_world_m))
            yield _Message(time_ns, "/ball_cameras", ros.TEXT, messages.text("+".join(point.uvs_px)))
            drawn = messages.ball(at_ns, point.p_world_m, true=False)
            yield _Message(time_ns, "/ball_marker", ros.MARKER, drawn)
        prediction = step.chain.prediction
        if prediction is not None and step.chain.is_new and len(prediction.curve_t_s) > 1:
            times_ns = np.rint(np.asarray(prediction.curve_t_s) * 1e9).astype(np.int64) + 1000 * clock
            path = messages.path(time_ns, times_ns, prediction.curve_ps_world_m)
            yield _Message(time_ns, "/prediction", ros.PATH, path)
            names = messages.text("+".join(step.chain.predicted_from))
            yield _Message(time_ns, "/prediction_cameras", ros.TEXT, names)


def _truth(recording: Recording, span: Span, messages: RosMessages) -> Iterator[_Message]:
    """Messages of the table, and of the true ball if the recording has it."""
    clock = clock_us(recording)
    start_ns = 1000 * (span.start_us + clock)
    if calibrations_of(recording) or recording.ball is not None:
        yield _Message(start_ns, "/table", ros.MARKER, messages.table(start_ns))
    ball = recording.ball
    if ball is None:
        return
    first, last = (int(row) for row in np.searchsorted(ball.t_us, (span.start_us, span.end_us)))
    for row in range(first, last):
        if ball.visible[row]:
            time_ns = 1000 * (int(ball.t_us[row]) + clock)
            yield _Message(time_ns, "/ball_true", ros.POINT, messages.point(time_ns, ball.p_world_m[row]))
            drawn = messages.ball(time_ns, ball.p_world_m[row], true=True)
            yield _Message(time_ns, "/ball_marker", ros.MARKER, drawn)


def _racket(recording: Recording, span: Span, rows: Rows | None, messages: RosMessages) -> Iterator[_Message]:
    if rows is None:
        return
    clock = clock_us(recording)
    for t_us, p, q in zip(rows["t_us"], rows["p_world_m"], rows["q_world_wxyz"], strict=True):
        if span.start_us <= t_us < span.end_us:
            time_ns = 1000 * (int(t_us) + clock)
            yield _Message(time_ns, "/racket", ros.POSE, messages.pose(time_ns, p, q))


def _pictures(recording: Recording, span: Span, messages: RosMessages) -> list[Iterable[_Message]]:
    """The pictures of ordinary cameras and of event cameras that take some, one stream each."""

    def of(name: str, frames: FrameStream) -> Iterator[_Message]:
        topic, clock = f"/{name}/image/compressed", clock_us(recording)
        for number in frames.of_span(span.start_us, span.end_us):
            image = frames.image(number)
            shown = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
            png = cv2.imencode(".png", shown, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
            time_ns = 1000 * (int(frames.t_us[number]) + clock)
            yield _Message(time_ns, topic, ros.IMAGE, messages.image(time_ns, name, png))

    return [of(name, frames) for name, frames in frames_of(recording).items()]
