"""Which lens model a calibration file states, by the names of ROS, OpenCV, Kalibr and others, and its coefficients."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration_values import CalibrationNode, plain_key, short_repr
from core.cameras.distortion import COEFFICIENTS, LensModel
from core.errors import CalibrationError

Array = NDArray[np.float64]

MODEL_KEY: Final = re.compile(
    r"(lens|camera|distortion|projection|calibration|intrinsics?|model)?(model|type|kind)|"
    r"(lens|model|distortion|projection)(name)?"
)
"""Names of keys that may state the lens model, in small letters without signs."""
LOOSE_KEYS: Final = frozenset({"type", "kind", "model", "modelname", "cameratype", "camerakind", "calibrationtype"})
"""These may state the maker's name of the camera, or its kind, too."""
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
FOREIGN_NAMES: Final = frozenset(
    {
        "omnidir", "omnidirectional", "omni", "mei", "ucm", "eucm", "ds", "doublesphere", "fov", "atan", "scaramuzza",
        "ocam", "ocamcalib", "unified", "unifiedcamera", "extendedunified", "division", "spherical", "equirectangular",
        "equisolid", "equisolidangle", "stereographic", "orthographic", "cylindrical", "panoramic", "ftheta",
        "thinprismfisheye", "fullopencv", "cahvor", "scaramuzzafisheye",
    }
)  # fmt: skip
"""Other lens models, which no key makes ours."""
PARTS: Final = re.compile(r"distort|lens|projection|intrinsic|mirror|camera")
"""Tables within a camera's that describe its lens."""
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

    Args:
        node: the keys of one camera in the file.
        coefficients: (D,) or (1, D) distortion as the file has it.
        asked: the model that the user states.
        default: the format's name of the model for files that name none.

    Raises:
        CalibrationError: for another model, a wrong number of coefficients, or statements that contradict each other.
    """
    names = _stated(node)
    if not names and default is not None:
        names = [default]
    flat = coefficients.ravel()
    # The most coefficients that OpenCV's pinhole has.
    most, model = 14, None
    for name in names:
        plain = plain_key(name)
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
    """What the keys of a file call the lens, whatever they are called.

    Raises:
        CalibrationError: where the name of a model belongs stands something else, or another model's parameter.
    """
    names: list[str] = []
    for key, value in _values_of_lens(node):
        word = plain_key(key)
        if word in ("fisheyemodel", "fisheye", "isfisheye"):
            if value is not None:
                names.append("pinhole" if value in (0, False, "0", "false") else "fisheye")
        elif word in ("xi", "mirrorxi") and value not in (0, 0.0, "0", None):
            got = f"{key} {short_repr(value)}, of an omnidirectional (Mei) camera"
            raise CalibrationError("unsupported lens model", expected=SUPPORTED, got=got, where=node.where)
        elif MODEL_KEY.fullmatch(word):
            if value is not None and not isinstance(value, str):
                if word in LOOSE_KEYS or not word.endswith(("model", "type", "name")):
                    continue  # `distortion` may be a list of coefficients
                what = f"{key} is no lens model"
                raise CalibrationError(what, expected="a name", got=short_repr(value), where=node.where)
            plain = plain_key(value or "")
            known = plain in FISHEYE_NAMES or (plain in PINHOLE_COUNTS and plain) or plain in FOREIGN_NAMES
            # A maker's name has a number (DAVIS346, EVK4); a word alone is a model that is not ours.
            named = word in ("model", "modelname") and value and not re.search(r"\d", value)
            if known or named or word not in LOOSE_KEYS:
                names.append(value or "")
    return names


def _values_of_lens(node: CalibrationNode) -> Iterator[tuple[str, object]]:
    """The keys of a camera with their values, and those of the tables within that describe its lens."""
    for key, value in node.values.items():
        if isinstance(value, dict) and PARTS.search(key.lower()):
            yield from ((str(inner), item) for inner, item in value.items())
        yield key, value


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
