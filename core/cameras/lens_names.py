"""Which lens model a calibration file states, by the names of ROS, OpenCV, Kalibr and others, and its coefficients."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration_values import CalibrationNode, short_repr
from core.cameras.distortion import COEFFICIENTS, LensModel
from core.errors import CalibrationError

Array = NDArray[np.float64]

MODEL_KEYS: Final = (
    "distortion_model",
    "distortion_type",
    "camera_model",
    "projection_model",
    "model_type",
    "lens_model",
    "camera_type",
    "type",
    "model",
)
PINHOLE_COUNTS: Final[dict[str, int]] = {
    "plumbbob": 5,
    "radtan": 5,
    "radialtangential": 5,
    "brownconrady": 5,
    "brown": 5,
    "rationalpolynomial": 8,
    "rational": 8,
    "pinholefull": 8,
    "thinprism": 12,
    "thinprismpolynomial": 12,
    "tilted": 14,
    "pinhole": 14,
    "perspective": 14,
    "opencv": 14,
    "none": 0,
    "": 14,
}
"""Names of the pinhole's distortions -> most coefficients that are not 0."""
FISHEYE_NAMES: Final = frozenset(
    {"equidistant", "equi", "fisheye", "opencvfisheye", "kannalabrandt", "kannalabrandt4", "kannalabrandt8", "kb4"}
)
ZERO_ONLY: Final = frozenset({"inversebrownconrady", "modifiedbrownconrady"})
"""RealSense's: another direction of the same polynomial, the same where all is 0."""
SUPPORTED: Final = "pinhole (radtan, plumb_bob, rational, thin prism) or fisheye (equidistant, Kannala-Brandt)"


@dataclass(frozen=True, slots=True, eq=False)
class LensFound:
    """The lens that a file describes."""

    model: LensModel
    distortion: Array
    assumed: str = ""
    """What the file does not say and was taken for granted, in words."""


def find_lens(
    node: CalibrationNode, coefficients: Array, *, asked: LensModel | None = None, default: str | None = None
) -> LensFound:
    """The model that the keys state and its coefficients; a model that is not ours is refused by its name.

    `asked` is what the user says, `default` the name that the format has for what a file leaves out.

    Raises:
        CalibrationError: for another model, a wrong number of coefficients, or statements that contradict each other.
    """
    names = _stated(node)
    if not names and default is not None:
        names = [default]
    flat = coefficients.ravel()
    most, model = 14, None
    for name in names:
        plain = re.sub(r"[^a-z0-9]", "", name.lower())
        if plain in ZERO_ONLY and not flat.any():
            plain = "none"
        if plain in FISHEYE_NAMES:
            model = "fisheye"
        elif plain in PINHOLE_COUNTS:
            most = min(most, PINHOLE_COUNTS[plain])
        else:
            raise CalibrationError("unsupported lens model", expected=SUPPORTED, got=name[:60], where=node.where)
    if model is None and names:
        model = "pinhole"
    if model == "fisheye" and most < 14:
        raise CalibrationError("two lens models", expected="one", got=" and ".join(names)[:80], where=node.where)
    if asked is not None and model is not None and asked != model:
        raise CalibrationError("the file says another lens model", expected=asked, got=model, where=node.where)
    assumed = ""
    if model is None:
        model = asked or "pinhole"
        if asked is None and flat.size == 4 and flat.any():
            assumed = (
                f"{node.where} names no lens model: its 4 coefficients are read as k1 k2 p1 p2 of a pinhole; "
                "--calibration-model fisheye reads them as a fisheye lens's"
            )
    return LensFound(model, _sized(flat, model, most if model == "pinhole" else 4, node.where), assumed)


def _stated(node: CalibrationNode) -> list[str]:
    """What the keys of a file call the lens."""
    names: list[str] = []
    for key in MODEL_KEYS:
        if key not in node.values:
            continue
        value = node.get(key)
        if value is None:
            value = ""
        if not isinstance(value, str):
            what = f"{key} is no lens model"
            raise CalibrationError(what, expected="a name", got=short_repr(value), where=node.where)
        plain = re.sub(r"[^a-z0-9]", "", value.lower())
        known = plain in FISHEYE_NAMES or plain in PINHOLE_COUNTS
        if key not in ("type", "model", "camera_type") or known:  # these may mean anything: the maker's name
            names.append(value)
    for key in ("fisheye_model", "fisheye", "is_fisheye"):
        value = node.values.get(key)
        if value not in (None, 0, False, "0", "false"):
            names.append("fisheye")
        elif value is not None:
            names.append("pinhole")
    return names


def _sized(flat: Array, model: LensModel, most: int, where: str) -> Array:
    """The coefficients in one of the model's own numbers, zeros at the end left out or added."""
    last = int(np.flatnonzero(flat)[-1]) + 1 if flat.any() else 0
    if model == "pinhole" and flat.size not in (0, 4, *COEFFICIENTS["pinhole"]):
        expected = "4, 5, 8, 12 or 14"
        raise CalibrationError("wrong number of distortion coefficients", expected=expected, got=flat.size, where=where)
    if last > most or (model == "fisheye" and flat.size < 4 and flat.size):
        expected = f"{most} for this lens model"
        raise CalibrationError("wrong number of distortion coefficients", expected=expected, got=flat.size, where=where)
    length = next(count for count in COEFFICIENTS[model] if count >= last)
    sized = np.zeros(length)
    kept = min(length, flat.size)
    sized[:kept] = flat[:kept]
    return sized
