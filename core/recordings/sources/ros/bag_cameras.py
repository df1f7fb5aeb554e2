"""Lenses and poses of the cameras of a bag: sensor_msgs/CameraInfo, and where they stand by tf_static.

A camera's CameraInfo is the one in its own namespace, or else the one of its frame. Its pose comes from the static
transforms; without any, two cameras stand to each other as the matrices R and P of a rectified pair say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.cameras.calibration_values import CalibrationNode
from core.cameras.lens_names import LensFound, find_lens
from core.cameras.opencv_yaml import pose_of_rectified
from core.cameras.plausible import check_lenses, odd_lenses
from core.cameras.units import check_lengths
from core.errors import CalibrationError
from core.events import SensorSize
from core.geometry import invert_transform, make_transform, matrix_from_quaternion
from core.recordings.sources.ros.bags import Bag, Topic

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_INFO: Final = "sensor_msgs/msg/CameraInfo"
_TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"
_STATIC: Final = "tf_static"
_ROOTS: Final = ("world", "table", "map", "odom")
"""Frames that are the world, where there are several."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BagCamera:
    """An event camera that wants its calibration."""

    sensor: SensorSize
    frame_id: str


@dataclass(frozen=True, slots=True)
class _Info:
    topic: str
    frame_id: str
    size: tuple[int, int]
    names: str
    """What it calls the lens model."""
    K: Array
    coefficients: Array
    R: Array
    P: Array


def message_of(bag_topic: Topic, data: bytes, stores: dict[bool, Typestore]) -> object:
    """A message of one of the common types of ROS; `stores` keeps what was loaded."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if bag_topic.ros1 not in stores:
        stores[bag_topic.ros1] = get_typestore(Stores.ROS1_NOETIC if bag_topic.ros1 else Stores.ROS2_HUMBLE)
        if bag_topic.ros1:  # it is not among the types of ROS 1 that the library knows
            types = get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", _TRANSFORMS)
            stores[True].register(types)
    store = stores[bag_topic.ros1]
    read = store.deserialize_ros1 if bag_topic.ros1 else store.deserialize_cdr
    return read(data, bag_topic.type)


def cameras_of(bag: Bag, wanted: dict[str, BagCamera], notes: list[str]) -> dict[str, Camera]:
    """Calibrated cameras by the topic of their events; `notes` tells what was left out, and why."""
    stores: dict[bool, Typestore] = {}
    infos = _infos(bag, stores, notes)
    chosen = {topic: info for topic, camera in wanted.items() if (info := _info_of(topic, camera, infos)) is not None}
    usable = {topic: info for topic, info in chosen.items() if _is_usable(info, wanted[topic].sensor, notes)}
    if not usable:
        return {}
    poses = _poses(usable, _static_transforms(bag, stores, notes), len(wanted), notes)
    found: dict[str, Camera] = {}
    for topic, info in usable.items():
        if topic not in poses:
            continue
        try:
            lens = _lens(info)
            camera = Camera(wanted[topic].sensor, info.K, lens.distortion, poses[topic], lens.model)
            check_lenses({topic: camera}, "CameraInfo")
        except CalibrationError as error:
            notes.append(f"The calibration of {info.topic} is left out: {error}.")
            continue
        found[topic] = camera
        notes.extend(f"{note}." for note in (lens.assumed, *odd_lenses({topic: camera})) if note)
    try:
        check_lengths(found, "tf_static or P")
    except CalibrationError as error:
        notes.append(f"The calibration is left out: {error}.")
        return {}
    return found


def _infos(bag: Bag, stores: dict[bool, Typestore], notes: list[str]) -> list[_Info]:
    infos: list[_Info] = []
    for topic in bag.topics.values():
        if topic.type != _INFO:
            continue
        data = next((data for _, data in bag.messages(topic.name)), None)
        if data is None:
            continue
        try:
            infos.append(_info(topic.name, message_of(topic, data, stores)))
        except Exception as error:  # noqa: BLE001 (the library passes on whatever its parts raise)
            notes.append(f"{topic.name} is left out: its CameraInfo is damaged ({error}).")
    return infos


def _info(topic: str, message: object) -> _Info:
    def field(name: str, shape: tuple[int, ...]) -> Array:
        values = getattr(message, name, None)
        return np.asarray(getattr(message, name.lower()) if values is None else values, np.float64).reshape(shape)

    header = getattr(message, "header")  # noqa: B009 (typed as any message)
    coefficients = field("D", (-1,))
    size = int(getattr(message, "width", 0)), int(getattr(message, "height", 0))
    model = str(getattr(message, "distortion_model", ""))
    K, R, P = field("K", (3, 3)), field("R", (3, 3)), field("P", (3, 4))
    return _Info(topic, str(header.frame_id), size, model, K, coefficients, R, P)


def _info_of(topic: str, camera: BagCamera, infos: list[_Info]) -> _Info | None:
    space = topic.rsplit("/", 1)[0]
    near = [info for info in infos if info.topic.rsplit("/", 1)[0] == space]
    same = [info for info in infos if camera.frame_id and info.frame_id == camera.frame_id]
    return next(iter(near or same), None)


def _lens(info: _Info) -> LensFound:
    """Raises CalibrationError for a lens model that is not ours."""
    stated: dict[str, object] = {"distortion_model": info.names} if info.names else {}
    return find_lens(CalibrationNode(stated, info.topic), info.coefficients)


def _is_usable(info: _Info, sensor: SensorSize, notes: list[str]) -> bool:
    why = None
    if not info.K[0, 0] > 0:
        why = "the camera is not calibrated, its K is 0"
    elif info.size != (0, 0) and info.size != (sensor.width_px, sensor.height_px):
        why = f"it is for a picture of {info.size[0]}x{info.size[1]}, the sensor is {sensor}"
    else:
        try:
            _lens(info)
        except CalibrationError as error:
            why = str(error)
    if why is not None:
        notes.append(f"The calibration of {info.topic} is left out: {why}; --calibration gives another.")
    return why is None


def _static_transforms(bag: Bag, stores: dict[bool, Typestore], notes: list[str]) -> dict[tuple[str, str], Array]:
    """`T_parent_child` of every static transform."""
    found: dict[tuple[str, str], Array] = {}
    for topic in bag.topics.values():
        if topic.type != _TRANSFORMS or topic.name.rsplit("/", 1)[-1] != _STATIC:
            continue
        for _, data in bag.messages(topic.name):
            try:
                message = message_of(topic, data, stores)
                for one in getattr(message, "transforms", ()):
                    move, turn = one.transform.translation, one.transform.rotation
                    R = matrix_from_quaternion((turn.w, turn.x, turn.y, turn.z))
                    T = make_transform(R, (move.x, move.y, move.z))
                    found[one.header.frame_id.strip("/"), one.child_frame_id.strip("/")] = T
            except Exception as error:  # noqa: BLE001
                notes.append(f"{topic.name}: a message is damaged ({error}).")
    return found


def _poses(
    infos: dict[str, _Info], transforms: dict[tuple[str, str], Array], cameras: int, notes: list[str]
) -> dict[str, Array]:
    """`T_world_camera` by topic."""
    frames = {topic: info.frame_id.strip("/") for topic, info in infos.items()}
    for root in [*_ROOTS, *dict.fromkeys(parent for parent, _ in transforms), *frames.values()]:
        reached = _reached(root, transforms)
        complete = all(frame in reached for frame in frames.values()) and len(set(frames.values())) == len(frames)
        if complete and (len(reached) > 1 or cameras == 1):
            if len(reached) == 1:
                notes.append("The bag does not tell where the camera stands: its calibration has no pose.")
            return {topic: reached[frame] for topic, frame in frames.items()}
    pair = _rectified_pair(infos)
    if pair is not None:
        notes.append("The poses of the cameras are those of their rectification; the left camera is the world.")
        return pair
    notes.append("The calibration is left out: the bag does not tell where the cameras stand; --calibration gives it.")
    return {}


def _reached(root: str, transforms: dict[tuple[str, str], Array]) -> dict[str, Array]:
    """`T_root_frame` of all frames that transforms connect with `root`."""
    reached = {root: np.eye(4)}
    while True:
        size = len(reached)
        for (parent, child), T_parent_child in transforms.items():
            if parent in reached and child not in reached:
                reached[child] = reached[parent] @ T_parent_child
            elif child in reached and parent not in reached:
                reached[parent] = reached[child] @ invert_transform(T_parent_child)
        if len(reached) == size:
            return reached


def _rectified_pair(infos: dict[str, _Info]) -> dict[str, Array] | None:
    """The poses of two cameras from R and P; the left one, whose P has no shift, is the world."""
    if len(infos) != 2:
        return None
    left, right = sorted(infos, key=lambda topic: infos[topic].P[0, 3] != 0)
    T = pose_of_rectified([infos[one].R for one in (left, right)], [infos[one].P for one in (left, right)])
    return None if T is None else {left: np.eye(4), right: T}
