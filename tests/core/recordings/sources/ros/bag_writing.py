"""Bags for the tests, written with the libraries of ROS bags and MCAP and by hand, never with our own writers."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

EVENT = "uint16 x\nuint16 y\n{time} ts\nbool polarity\n"
EVENT_ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\nEvent[] events\n"
EVENT_PACKET = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    "bool is_bigendian\nuint8[] events\n"
)
EPOCH_S = 1_700_000_000


def store_of(ros1: bool):
    """The types of ROS with those of event cameras."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    time = "time" if ros1 else "builtin_interfaces/Time"
    for package in ("dvs_msgs", "prophesee_event_msgs"):
        store.register(get_types_from_msg(EVENT.format(time=time), f"{package}/msg/Event"))
        store.register(get_types_from_msg(EVENT_ARRAY, f"{package}/msg/EventArray"))
    if ros1:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf2_msgs/msg/TFMessage"))
    store.register(get_types_from_msg(EVENT_PACKET, "event_camera_msgs/msg/EventPacket"))
    return store


class BagMaker:
    """A bag that is being written: `add` takes a topic and a message, made with `make`."""

    def __init__(self, path: Path, kind: str) -> None:
        self.ros1 = kind == "ros1"
        self.store = store_of(self.ros1)
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        self.writer = Writer1(path) if self.ros1 else Writer2(path, version=9, storage_plugin=plugin)
        self.connections = {}

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def make(self, kind: str, **fields):
        return self.store.types[kind](**fields)

    def header(self, stamp_ns: int, frame_id: str = "cam"):
        time = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        extra = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame_id, **extra)

    def add(self, topic: str, message, time_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        data = self.store.serialize_ros1(message, kind) if self.ros1 else self.store.serialize_cdr(message, kind)
        self.writer.write(self.connections[topic], time_ns, bytes(data))

    def add_events(self, topic: str, events, *, package="dvs_msgs", size=(346, 260), frame_id="cam") -> None:
        """A message of events, each (t_us since 1970, x, y, on)."""
        stamp = self.header(events[0][0] * 1000 if events else EPOCH_S * 10**9, frame_id)
        rows = [
            self.make(
                f"{package}/msg/Event",
                x=x,
                y=y,
                ts=self.make("builtin_interfaces/msg/Time", sec=t // 10**6, nanosec=t % 10**6 * 1000),
                polarity=on,
            )
            for t, x, y, on in events
        ]
        fields = {"header": stamp, "height": size[1], "width": size[0], "events": rows}
        self.add(topic, self.make(f"{package}/msg/EventArray", **fields), events[0][0] * 1000 if events else 0)

    def add_packet(self, topic: str, data: bytes, encoding: str, stamp_ns: int, **fields) -> None:
        values = {"height": 480, "width": 640, "seq": 0, "time_base": 0, "is_bigendian": False} | fields
        header, content = self.header(stamp_ns), np.frombuffer(data, np.uint8)
        message = self.make(
            "event_camera_msgs/msg/EventPacket", header=header, encoding=encoding, events=content, **values
        )
        self.add(topic, message, stamp_ns)

    def add_info(self, topic: str, frame_id: str, K, D, *, size=(346, 260), R=None, P=None, model="plumb_bob") -> None:
        names = {"D": D, "K": np.ravel(K), "R": np.ravel(np.eye(3) if R is None else R)}
        names["P"] = np.ravel(np.zeros((3, 4)) if P is None else P)
        arrays = {name if self.ros1 else name.lower(): np.asarray(value, float) for name, value in names.items()}
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        header = self.header(EPOCH_S * 10**9, frame_id)
        fields = {"height": size[1], "width": size[0], "distortion_model": model, "binning_x": 0, "binning_y": 0}
        message = self.make("sensor_msgs/msg/CameraInfo", header=header, roi=roi, **fields, **arrays)
        self.add(topic, message, EPOCH_S * 10**9)

    def add_image(self, topic: str, image, encoding: str, stamp_us: int, pad: int = 0) -> None:
        height, width = image.shape[:2]
        rows = np.pad(image.reshape(height, -1), ((0, 0), (0, pad)))
        fields = {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": rows.shape[1]}
        header = self.header(stamp_us * 1000)
        self.add(topic, self.make("sensor_msgs/msg/Image", header=header, data=rows.ravel(), **fields), stamp_us * 1000)

    def add_static_transform(self, parent: str, child: str, move, turn_xyzw) -> None:
        turn = self.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn_xyzw, strict=True)))
        shift = self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", move, strict=True)))
        one = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(EPOCH_S * 10**9, parent),
            child_frame_id=child,
            transform=self.make("geometry_msgs/msg/Transform", translation=shift, rotation=turn),
        )
        self.add("/tf_static", self.make("tf2_msgs/msg/TFMessage", transforms=[one]), EPOCH_S * 10**9)


def evt3_words(events, first_high: int = 0) -> bytes:
    """EVT3 words, written out one by one, of events (t_us, x, y, on) on the camera's clock."""
    words = []
    for t, x, y, on in events:
        words += [0x8000 | (t >> 12) & 0xFFF, 0x6000 | t & 0xFFF, y, 0x2000 | int(on) << 11 | x]
    return struct.pack(f"<{len(words)}H", *words)


def mono_words(events, time_base_us: int) -> bytes:
    """The mono encoding: 64 bits an event, times in ns after the time base."""
    words = [int(on) << 63 | y << 48 | x << 32 | (t - time_base_us) * 1000 for t, x, y, on in events]
    return struct.pack(f"<{len(words)}Q", *words)


def libcaer_words(events, time_base_us: int) -> bytes:
    """libcaer's polarity events: 32 bits of place and polarity, 32 of us."""
    parts = [struct.pack("<Ii", x << 17 | y << 2 | int(on) << 1 | 1, t - time_base_us) for t, x, y, on in events]
    return b"".join(parts)
