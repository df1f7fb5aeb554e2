"""Messages of ROS 2 and Foxglove, serialised without ROS, and the two file types for them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.cameras import Camera
from core.errors import CommandError
from core.geometry import quaternion_from_matrix
from core.table import BALL_RADIUS_M, TABLE_HEIGHT_M, TABLE_LENGTH_M, TABLE_WIDTH_M

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

WORLD: Final = "world"
"""Name of the world frame: origin at the centre of the table's top, x along its length, z up."""
EVENT_PACKET: Final = "event_camera_msgs/msg/EventPacket"
CAMERA_INFO: Final = "sensor_msgs/msg/CameraInfo"
IMAGE: Final = "sensor_msgs/msg/CompressedImage"
TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
POINT: Final = "geometry_msgs/msg/PointStamped"
POSE: Final = "geometry_msgs/msg/PoseStamped"
PATH: Final = "nav_msgs/msg/Path"
TEXT: Final = "std_msgs/msg/String"
MARKER: Final = "visualization_msgs/msg/Marker"
ANNOTATIONS: Final = "foxglove_msgs/msg/ImageAnnotations"
_PIXEL_CENTRE: Final = 0.5
"""Foxglove counts pixels from the corner of the first one, we from its centre."""
_TABLE_THICKNESS_M: Final = 0.03
_BALL_RGBA: Final = (1.0, 0.55, 0.12, 1.0)
_TRUTH_RGBA: Final = (0.16, 0.86, 0.86, 1.0)
_TABLE_RGBA: Final = (0.1, 0.3, 0.65, 1.0)
_CUBE, _SPHERE = 1, 2
_DEFINITIONS: Final = {
    EVENT_PACKET: (
        "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
        "bool is_bigendian\nuint8[] events\n"
    ),
    "foxglove_msgs/msg/Point2": "float64 x\nfloat64 y\n",
    "foxglove_msgs/msg/Color": "float64 r\nfloat64 g\nfloat64 b\nfloat64 a\n",
    "foxglove_msgs/msg/CircleAnnotation": (
        "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nfloat64 diameter\nfloat64 thickness\n"
        "foxglove_msgs/Color fill_color\nfoxglove_msgs/Color outline_color\n"
    ),
    "foxglove_msgs/msg/PointsAnnotation": (
        "uint8 UNKNOWN=0\nuint8 POINTS=1\nuint8 LINE_LOOP=2\nuint8 LINE_STRIP=3\nuint8 LINE_LIST=4\n"
        "builtin_interfaces/Time timestamp\nuint8 type\nfoxglove_msgs/Point2[] points\n"
        "foxglove_msgs/Color outline_color\nfoxglove_msgs/Color[] outline_colors\nfoxglove_msgs/Color fill_color\n"
        "float64 thickness\n"
    ),
    "foxglove_msgs/msg/TextAnnotation": (
        "builtin_interfaces/Time timestamp\nfoxglove_msgs/Point2 position\nstring text\nfloat64 font_size\n"
        "foxglove_msgs/Color text_color\nfoxglove_msgs/Color background_color\n"
    ),
    ANNOTATIONS: (
        "foxglove_msgs/CircleAnnotation[] circles\nfoxglove_msgs/PointsAnnotation[] points\n"
        "foxglove_msgs/TextAnnotation[] texts\n"
    ),
}


def distortion_model(camera: Camera) -> str:
    """What ROS calls the lens. Raises CommandError where it has no name for it."""
    if camera.model == "fisheye":
        return "equidistant"
    if camera.distortion[8:].any():
        raise CommandError(
            "ROS has no name for a lens with thin prism or tilt coefficients",
            expected="plumb_bob, rational_polynomial or equidistant",
            got=f"{len(camera.distortion)} coefficients",
            remedy="export it to another format, or import the recording without --calibration",
        )
    return "plumb_bob" if len(camera.distortion) == 5 else "rational_polynomial"


class MessageFile(Protocol):
    """A file that messages are written to."""

    def add(self, topic: str, kind: str, time_ns: int, data: bytes) -> None:
        """Append a serialised message."""
        ...


class RosMessages:
    """Serialises messages: each method returns the bytes of one. Times in ns since 1970, or since the start if
    unknown.
    """

    def __init__(self) -> None:
        """Raises CommandError where rosbags is missing."""
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError as error:
            raise CommandError("messages of ROS need rosbags", remedy="pip install 'rallyscope[ros]'") from error
        self.store: Typestore = get_typestore(Stores.ROS2_HUMBLE)
        for kind, text in _DEFINITIONS.items():
            self.store.register(get_types_from_msg(text, kind))

    def definition(self, kind: str) -> str:
        """Definition text of a message type and its nested types."""
        return self.store.generate_msgdef(kind, ros_version=2)[0]

    def events(self, time_ns: int, camera: str, size: tuple[int, int], number: int, words: NDArray[np.uint16]) -> bytes:
        """An EventPacket of EVT3 words.

        Args:
            time_ns: of the first event.
            camera: frame of the header.
            size: width and height, px.
            number: of the packet.
            words: (N,) EVT3.
        """
        content = np.frombuffer(words.astype("<u2").tobytes(), np.uint8)
        fields = {"height": size[1], "width": size[0], "seq": number, "time_base": 0, "is_bigendian": False}
        header = self._header(time_ns, camera)
        return self._bytes(EVENT_PACKET, header=header, encoding="evt3", events=content, **fields)

    def camera_info(self, time_ns: int, name: str, camera: Camera) -> bytes:
        """CameraInfo message of a calibrated camera."""
        whole = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        P = np.concatenate([camera.K, np.zeros((3, 1))], axis=1)
        return self._bytes(
            CAMERA_INFO,
            header=self._header(time_ns, name),
            height=camera.sensor.height_px,
            width=camera.sensor.width_px,
            distortion_model=distortion_model(camera),
            d=np.array(camera.distortion[:8], np.float64),
            k=np.array(camera.K, np.float64).ravel(),
            r=np.eye(3).ravel(),
            p=P.ravel(),
            binning_x=0,
            binning_y=0,
            roi=self._make("sensor_msgs/msg/RegionOfInterest", **whole),
        )

    def poses_of_cameras(self, time_ns: int, cameras: dict[str, Camera]) -> bytes:
        """Static transforms from the world to the cameras."""
        transforms = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self._header(time_ns, WORLD),
                child_frame_id=name,
                transform=self._make(
                    "geometry_msgs/msg/Transform",
                    translation=self._numbers("geometry_msgs/msg/Vector3", "xyz", camera.position_world_m),
                    rotation=self._rotation(quaternion_from_matrix(camera.T_world_camera[:3, :3])),
                ),
            )
            for name, camera in cameras.items()
        ]
        return self._bytes(TRANSFORMS, transforms=transforms)

    def point(self, time_ns: int, p_world_m: ArrayLike) -> bytes:
        """A point in the world."""
        return self._bytes(POINT, header=self._header(time_ns, WORLD), point=self._point(p_world_m))

    def text(self, text: str) -> bytes:
        """A text; it has no time of its own."""
        return self._bytes(TEXT, data=text)

    def pose(self, time_ns: int, p_world_m: ArrayLike, q_wxyz: ArrayLike) -> bytes:
        """A pose in the world."""
        return self._bytes(POSE, header=self._header(time_ns, WORLD), pose=self._pose(p_world_m, q_wxyz))

    def path(self, time_ns: int, times_ns: NDArray[np.int64], ps_world_m: NDArray[np.float64]) -> bytes:
        """A flight, each of its points with its own time."""
        poses = [
            self._make(POSE, header=self._header(int(at), WORLD), pose=self._pose(p, (1, 0, 0, 0)))
            for at, p in zip(times_ns, ps_world_m, strict=True)
        ]
        return self._bytes(PATH, header=self._header(time_ns, WORLD), poses=poses)

    def ball(self, time_ns: int, p_world_m: ArrayLike, *, true: bool) -> bytes:
        """Marker of a ball."""
        size = np.full(3, 2 * BALL_RADIUS_M)
        return self._marker(time_ns, _SPHERE, p_world_m, size, _TRUTH_RGBA if true else _BALL_RGBA, int(true))

    def table(self, time_ns: int) -> bytes:
        """Marker of the table; its top is the plane z = 0."""
        size = np.array([TABLE_LENGTH_M, TABLE_WIDTH_M, _TABLE_THICKNESS_M])
        assert _TABLE_THICKNESS_M < TABLE_HEIGHT_M
        return self._marker(time_ns, _CUBE, (0, 0, -_TABLE_THICKNESS_M / 2), size, _TABLE_RGBA, 2)

    def image(self, time_ns: int, camera: str, png: bytes) -> bytes:
        """A PNG picture of a camera."""
        content = np.frombuffer(png, np.uint8)
        return self._bytes(IMAGE, header=self._header(time_ns, camera), format="png", data=content)

    def circle(self, time_ns: int, u_px: float, v_px: float, r_px: float) -> bytes:
        """Circle of a detected ball in a picture.

        Args:
            time_ns: of the ball.
            u_px: column, counted from the middle of the first pixel.
            v_px: row.
            r_px: radius.
        """
        one = self._make(
            "foxglove_msgs/msg/CircleAnnotation",
            timestamp=self._time(time_ns),
            position=self._make("foxglove_msgs/msg/Point2", x=u_px + _PIXEL_CENTRE, y=v_px + _PIXEL_CENTRE),
            diameter=2 * r_px,
            thickness=1.0,
            fill_color=self._colour((0.0, 0.0, 0.0, 0.0)),
            outline_color=self._colour(_BALL_RGBA),
        )
        return self._bytes(ANNOTATIONS, circles=[one], points=[], texts=[])

    def _marker(
        self,
        time_ns: int,
        shape: int,
        p_world_m: ArrayLike,
        size_m: NDArray[np.float64],
        rgba: tuple[float, ...],
        number: int,
    ) -> bytes:
        time = "builtin_interfaces/msg/Duration"
        uv_files = {"texture_resource": "", "texture": self._empty_image(), "uv_coordinates": [], "mesh_resource": ""}
        mesh = {"mesh_file": self._make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8))}
        return self._bytes(
            MARKER,
            header=self._header(time_ns, WORLD),
            ns="rallyscope",
            id=number,
            type=shape,
            action=0,
            pose=self._pose(p_world_m, (1, 0, 0, 0)),
            scale=self._numbers("geometry_msgs/msg/Vector3", "xyz", size_m),
            color=self._make("std_msgs/msg/ColorRGBA", **dict(zip("rgba", rgba, strict=True))),
            lifetime=self._make(time, sec=0, nanosec=0),
            frame_locked=False,
            points=[],
            colors=[],
            text="",
            mesh_use_embedded_materials=False,
            **uv_files,
            **mesh,
        )

    def _empty_image(self) -> object:
        header = self._header(0, "")
        return self._make(IMAGE, header=header, format="", data=np.zeros(0, np.uint8))

    def _colour(self, rgba: tuple[float, ...]) -> object:
        return self._make("foxglove_msgs/msg/Color", **dict(zip("rgba", rgba, strict=True)))

    def _pose(self, p_m: ArrayLike, q_wxyz: ArrayLike) -> object:
        return self._make("geometry_msgs/msg/Pose", position=self._point(p_m), orientation=self._rotation(q_wxyz))

    def _point(self, p_m: ArrayLike) -> object:
        return self._numbers("geometry_msgs/msg/Point", "xyz", p_m)

    def _rotation(self, q_wxyz: ArrayLike) -> object:
        return self._numbers("geometry_msgs/msg/Quaternion", "wxyz", q_wxyz)

    def _numbers(self, kind: str, names: str, values: ArrayLike) -> object:
        return self._make(kind, **dict(zip(names, (float(value) for value in np.asarray(values)), strict=True)))

    def _header(self, time_ns: int, frame: str) -> object:
        return self._make("std_msgs/msg/Header", stamp=self._time(time_ns), frame_id=frame)

    def _time(self, time_ns: int) -> object:
        return self._make("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)

    def _make(self, kind: str, **fields: object) -> object:
        return self.store.types[kind](**fields)  # pyright: ignore[reportArgumentType]

    def _bytes(self, kind: str, **fields: object) -> bytes:
        return bytes(self.store.serialize_cdr(self._make(kind, **fields), kind))


class McapFile:
    """An MCAP file of ROS 2 messages; a context manager."""

    def __init__(self, path: Path, messages: RosMessages) -> None:
        """Raises CommandError where the library is missing."""
        try:
            from mcap.writer import CompressionType, Writer
        except ImportError as error:
            raise CommandError("an MCAP file needs mcap", remedy="pip install 'rallyscope[ros]'") from error
        self._messages = messages
        self._file = path.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def __enter__(self) -> McapFile:
        self._writer.start(profile="ros2", library="rallyscope")
        return self

    def add(self, topic: str, kind: str, time_ns: int, data: bytes) -> None:
        """Append a message."""
        if topic not in self._channels:
            if kind not in self._schemas:
                text = self._messages.definition(kind).encode()
                self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text)
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        self._writer.add_message(self._channels[topic], log_time=time_ns, data=data, publish_time=time_ns)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._writer.finish()
        finally:
            self._file.close()


class BagFolder:
    """A bag of ROS 2, a folder with a database; a context manager."""

    def __init__(self, folder: Path, messages: RosMessages) -> None:
        from rosbags.rosbag2 import Writer

        self._messages = messages
        self._writer = Writer(folder, version=8)
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> BagFolder:
        self._writer.open()
        return self

    def add(self, topic: str, kind: str, time_ns: int, data: bytes) -> None:
        """Append a message."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=self._messages.store)
        self._writer.write(self._connections[topic], time_ns, data)

    def __exit__(self, *error: object) -> None:
        self._writer.close()
