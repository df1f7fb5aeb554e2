"""The pictures of a bag: sensor_msgs/Image and CompressedImage, of an event camera itself or of ordinary cameras."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.events import SensorSize
from core.recordings.sources.ros.bag_cameras import message_of
from core.recordings.sources.ros.bags import Bag, Topic
from core.recordings.sources.source import DecodeReport, PictureTrack, TimedPicture

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_RAW: Final = "sensor_msgs/msg/Image"
_COMPRESSED: Final = "sensor_msgs/msg/CompressedImage"
_DRAWN: Final = ("render", "event_image", "depth", "mask", "mono_events")
"""Parts of topics that show drawings of events or maps, no pictures."""
_CHANNELS: Final = {"mono8": 1, "8UC1": 1, "rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4}
_BAYER: Final = {
    "bayer_rggb8": cv2.COLOR_BayerBG2RGB,
    "bayer_bggr8": cv2.COLOR_BayerRG2RGB,
    "bayer_gbrg8": cv2.COLOR_BayerGR2RGB,
    "bayer_grbg8": cv2.COLOR_BayerGB2RGB,
}
_TO_RGB: Final = {"bgr8": cv2.COLOR_BGR2RGB, "rgba8": cv2.COLOR_RGBA2RGB, "bgra8": cv2.COLOR_BGRA2RGB} | {
    "8UC3": cv2.COLOR_BGR2RGB
}


class _UnreadableError(Exception):
    """Why a picture is left out."""


def pictures_of(
    bag: Bag, cameras: dict[str, tuple[str, SensorSize]], notes: list[str]
) -> list[tuple[str | None, PictureTrack]]:
    """All tracks of pictures, with the topic of the event camera that took them; None for an ordinary camera.

    `cameras` are the names and sizes of the event cameras, by topic.
    """
    stores: dict[bool, Typestore] = {}
    found: list[tuple[str | None, PictureTrack]] = []
    taken = {name for name, _ in cameras.values()}
    owners: set[str] = set()
    for topic in bag.topics.values():
        if topic.type not in (_RAW, _COMPRESSED) or not topic.count:
            continue
        if any(part in topic.name for part in _DRAWN):
            notes.append(f"{topic.name} is left out: it seems to be drawn from events or to hold no picture.")
            continue
        data = next((data for _, data in bag.messages(topic.name)), None)
        if data is None:
            continue
        try:
            _, image = _picture(topic, data, stores)
        except _UnreadableError as error:
            notes.append(f"{topic.name} is left out: {error}.")
            continue
        size = SensorSize(image.shape[1], image.shape[0])
        owner = _owner(topic.name, size, cameras)
        # A second topic of the same size (rectified, say) is a camera of its own.
        if owner is not None and owner not in owners:
            owners.add(owner)
            found.append((owner, _track(bag, topic, None, size, stores)))
            continue
        name = _free_name(topic.name, taken)
        taken.add(name)
        found.append((None, _track(bag, topic, name, size, stores)))
    return found


def _owner(topic: str, size: SensorSize, cameras: dict[str, tuple[str, SensorSize]]) -> str | None:
    """The event camera of the same namespace whose pictures are as large as its sensor."""
    space = topic.rsplit("/", 1)[0]
    near = [events for events, (_, sensor) in cameras.items() if events.rsplit("/", 1)[0] == space and sensor == size]
    return near[0] if len(near) == 1 else None


def _free_name(topic: str, taken: set[str]) -> str:
    parts = [part for part in topic.strip("/").split("/") if not part.startswith(("image", "compressed"))]
    name = re.sub(r"[^0-9A-Za-z_-]+", "_", "_".join(parts)).strip("_") or "rgb"
    while name in taken or name == "ball":
        name += "_rgb"
    return name


def _track(bag: Bag, topic: Topic, name: str | None, size: SensorSize, stores: dict[bool, Typestore]) -> PictureTrack:
    def read(report: DecodeReport) -> Iterator[TimedPicture]:
        left_out, last_us = 0, None
        for _, data in bag.messages(topic.name):
            try:
                t_us, image = _picture(topic, data, stores)
            except _UnreadableError:
                left_out += 1
                continue
            if image.shape[:2] != (size.height_px, size.width_px) or (last_us is not None and t_us < last_us):
                left_out += 1
                continue
            last_us = t_us
            yield TimedPicture(t_us, 0, image)
        note = f"{topic.name}: {left_out:,} pictures were left out: damaged, or of another size or time."
        report.leave_out("pictures", left_out, note)
        if last_us is not None:
            report.assume(f"{topic.name}: the time of a picture is that of its header; its exposure is not told.")

    return PictureTrack(name, size, read)


def _picture(topic: Topic, data: bytes, stores: dict[bool, Typestore]) -> tuple[int, NDArray[np.uint8]]:
    try:
        message = message_of(topic, data, stores)
        stamp = message.header.stamp  # pyright: ignore[reportAttributeAccessIssue]
        t_us = int(stamp.sec) * 1_000_000 + int(stamp.nanosec) // 1000
        return t_us, _decompressed(message) if topic.type == _COMPRESSED else _unpacked(message)
    except _UnreadableError:
        raise
    except Exception as error:
        raise _UnreadableError(f"a message is damaged ({error})") from error


def _decompressed(message: object) -> NDArray[np.uint8]:
    content = np.asarray(message.data, np.uint8)  # pyright: ignore[reportAttributeAccessIssue]
    image = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)
    if image is None or image.dtype != np.uint8:
        raise _UnreadableError(f"its format {getattr(message, 'format', '')!r} is not read")
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB if image.shape[2] == 3 else cv2.COLOR_BGRA2RGB)
    return np.ascontiguousarray(image, np.uint8)


def _unpacked(message: object) -> NDArray[np.uint8]:
    encoding, height, width, step = (getattr(message, name) for name in ("encoding", "height", "width", "step"))
    channels = 1 if encoding in _BAYER else _CHANNELS.get(encoding)
    if channels is None:
        raise _UnreadableError(f"pictures of encoding {encoding!r} are not read")
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)  # pyright: ignore[reportAttributeAccessIssue]
    shape = (height, width) if channels == 1 else (height, width, channels)
    image = np.ascontiguousarray(rows[:, : width * channels]).reshape(shape)
    if encoding in _BAYER:
        return np.asarray(cv2.cvtColor(image, _BAYER[encoding]), np.uint8)
    return np.asarray(cv2.cvtColor(image, _TO_RGB[encoding]), np.uint8) if encoding in _TO_RGB else image
