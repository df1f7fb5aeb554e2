"""One camera as camodocal (VINS-Mono, VINS-Fusion) describes it, and the `ost.txt` of ROS's camera_calibration.

Neither knows where the camera is.
"""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from core.cameras.calibration_values import CalibrationNode, make_camera, read_numbers, read_size, short_repr
from core.cameras.camera import Camera
from core.cameras.distortion import LensModel
from core.cameras.lens_names import SUPPORTED
from core.errors import CalibrationError

_LENSES: Final[dict[str, tuple[LensModel, str, str]]] = {
    "PINHOLE": ("pinhole", "fx fy cx cy", "k1 k2 p1 p2"),
    "PINHOLE_FULL": ("pinhole", "fx fy cx cy", "k1 k2 p1 p2 k3 k4 k5 k6"),
    "KANNALA_BRANDT": ("fisheye", "mu mv u0 v0", "k2 k3 k4 k5"),
}
"""camodocal's models: ours, and the keys of the projection and of the distortion in our order."""
_ROS_INI: Final = re.compile(r"^\[image\]\s+width\s+(\S+)\s+height\s+(\S+)\s", re.MULTILINE)
_ROS_CAMERA: Final = re.compile(
    r"^camera matrix\s+((?:[-+.\deE]+\s+){9})distortion[ \t]*\n((?:[-+.\deE]+\s+)*)", re.MULTILINE
)


def looks_like_camodocal(tree: CalibrationNode) -> bool:
    """Whether the file has camodocal's model and projection."""
    return "model_type" in tree.values and isinstance(tree.values.get("projection_parameters"), dict)


def camera_from_camodocal(tree: CalibrationNode) -> dict[str, Camera]:
    """`camera`; the world is its frame.

    Raises:
        CalibrationError: if the model is not ours, or a key is missing.
    """
    stated = tree.get("model_type")
    lens = _LENSES.get(stated.upper()) if isinstance(stated, str) else None
    if lens is None:
        got = f"model_type {short_repr(stated)}"
        raise CalibrationError("unsupported camera model", expected=SUPPORTED, got=got, where=tree.where)
    model, projection, distortion = lens
    # Kannala-Brandt's coefficients stand among those of the projection.
    table = "projection_parameters" if model == "fisheye" else "distortion_parameters"
    fx, fy, cx, cy = _values(tree.child("projection_parameters"), projection)
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    coefficients = _values(tree.child(table), distortion)
    if model == "pinhole" and len(coefficients) == 4:
        coefficients.append(0.0)
    return {"camera": make_camera(read_size(tree), K, np.array(coefficients), np.eye(4), tree.where, model)}


def _values(node: CalibrationNode, keys: str) -> list[float]:
    return [float(read_numbers(CalibrationNode({key: [node.get(key)]}, node.where), key)[0]) for key in keys.split()]


def tree_from_ros_ini(text: str, where: str) -> CalibrationNode | None:
    """The values of an `ost.txt` under the keys of ROS's YAML; None for any other text.

    Raises:
        CalibrationError: if there is not exactly one camera in it.
    """
    size = _ROS_INI.search(text)
    if size is None:
        return None
    cameras = _ROS_CAMERA.findall(text)
    if len(cameras) != 1:
        remedy = "give one camera_info YAML a camera, or a pair with R and T"
        raise CalibrationError("ROS's INI is of one camera", got=f"{len(cameras)}", where=where, remedy=remedy)
    K, distortion = (words.split() for words in cameras[0])
    values: dict[str, object] = {
        "image_width": size[1],
        "image_height": size[2],
        "camera_matrix": [K[:3], K[3:6], K[6:]],
        "distortion_coefficients": distortion,
        # It names no model; of 4 numbers the fisheye and the pinhole are possible.
        **(
            {"distortion_model": "rational_polynomial" if len(distortion) > 5 else "plumb_bob"}
            if distortion[4:]
            else {}
        ),
    }
    return CalibrationNode(values, where)
