"""A lens from pictures of a board: OpenCV's calibration, with the pictures that do not fit left out and named.

Fisheye lenses (Kannala-Brandt) are fitted by OpenCV's `fisheye.calibrate`, with their uncertainty. A lens is written as
OpenCV's FileStorage YAML for names that end in .yaml or .yml, as our own TOML for all others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.board import Board, board_pose
from core.cameras.calibration.coverage import coverage
from core.cameras.calibration_file import save_calibration
from core.cameras.camera import Camera
from core.cameras.distortion import LensModel, fold_radius
from core.cameras.lens_kernel import FOLD_ANGLE
from core.errors import CalibrationError
from core.events import SensorSize
from core.files import replace_file

Array = NDArray[np.float64]

FISHEYE_PARAMETERS: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
STOP: Final = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9)
FIRST_ANGLES_DEG: Final = (90.0, 60.0, 40.0)
"""First guesses: how far off the axis the corner of the picture sees. From a bad one OpenCV finds nothing."""
FLAGS: Final = tuple(
    getattr(cv2.fisheye if hasattr(cv2.fisheye, name) else cv2, name)
    for name in ("CALIB_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW", "CALIB_USE_INTRINSIC_GUESS")
)
"""OpenCV 4 has flags of their own for the fisheye; 5 has one set for all."""


@dataclass(frozen=True, slots=True, eq=False)
class FisheyeFit:
    """A lens, its standard deviations and how well each view fits."""

    camera: Camera
    sigmas: dict[str, float]
    rms_px: Array
    """Per view."""
    total_rms_px: float


def fit_fisheye(views: Sequence[Array], board: Board, sensor: SensorSize) -> FisheyeFit:
    """The lens that explains the board's points (N, 2) of each view best.

    Raises:
        CalibrationError: if the pictures fix no such lens.
    """
    points = board.points_m[None]
    found = [one for angle in FIRST_ANGLES_DEG if (one := _calibrate(views, points, sensor, angle)) is not None]
    if not found:
        remedy = "tilt the board between the pictures, show it all over the picture, or fit a pinhole"
        raise CalibrationError("the pictures fix no fisheye lens", remedy=remedy)
    _, K, coefficients, rvecs, tvecs = min(found, key=lambda one: one[0])
    camera = Camera(sensor, np.asarray(K, np.float64), np.ravel(coefficients).astype(np.float64), np.eye(4), "fisheye")
    residuals: list[Array] = []
    information = np.zeros((8, 8))
    for view, rvec, tvec in zip(views, rvecs, tvecs, strict=True):
        seen, slopes = cv2.fisheye.projectPoints(
            points, np.ravel(rvec)[None], np.ravel(tvec)[None], camera.K, camera.distortion
        )
        residuals.append(view - np.asarray(seen, np.float64).reshape(-1, 2))
        lens, pose = slopes[:, :8], slopes[:, 8:14]  # fx fy cx cy k1 k2 k3 k4, then the turn and the shift
        information += lens.T @ lens - lens.T @ pose @ np.linalg.pinv(pose.T @ pose) @ pose.T @ lens
    squares = np.concatenate([residual.ravel() for residual in residuals]) ** 2
    freedom = max(1, len(squares) - 8 - 6 * len(views))
    deviations = np.sqrt(np.maximum(0.0, np.diag(np.linalg.pinv(information))) * squares.sum() / freedom)
    return FisheyeFit(
        camera,
        dict(zip(FISHEYE_PARAMETERS, deviations.tolist(), strict=True)),
        np.array([np.sqrt((residual**2).sum(axis=1).mean()) for residual in residuals]),
        float(np.sqrt(2 * squares.mean())),
    )


def _calibrate(
    views: Sequence[Array], points: Array, sensor: SensorSize, angle_deg: float
) -> tuple[float, Array, Array, Sequence[Array], Sequence[Array]] | None:
    """Error, K, coefficients and the poses of the board, from a first guess; None if OpenCV finds none."""
    size = (sensor.width_px, sensor.height_px)
    focal_px = 0.5 * float(np.hypot(*size)) / np.radians(angle_deg)
    K = np.array([[focal_px, 0, (size[0] - 1) / 2], [0, focal_px, (size[1] - 1) / 2], [0, 0, 1]], np.float64)
    try:
        rms, K, coefficients, rvecs, tvecs = cv2.fisheye.calibrate(
            [points] * len(views),
            [view[None] for view in views],
            size,
            K,
            np.zeros((4, 1)),
            flags=sum(FLAGS),
            criteria=STOP,
        )
    except cv2.error:
        return None
    numbers = np.concatenate([np.ravel(K), np.ravel(coefficients)])
    if not (np.isfinite(rms) and np.isfinite(numbers).all()):
        return None
    turns, moves = ([np.asarray(one, np.float64) for one in each] for each in (rvecs, tvecs))
    return float(rms), np.asarray(K, np.float64), np.asarray(coefficients, np.float64), turns, moves


PICTURES_AT_LEAST: Final = 6
"""Three would do for the equations; with fewer than six nothing shows that one of them is bad."""
OUTLIER_TIMES_MEDIAN: Final = 2.5
OUTLIER_FROM_PX: Final = 0.3
"""A picture is left out when its rms is above both; sharp pictures of a flat board have 0.05 to 0.3 px."""
PARAMETERS: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
COEFFICIENTS: Final = (0, 2, 4, 5)
"""How many of k1 k2 p1 p2 k3 may be fitted."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """The board's points in one picture."""

    name: str
    uvs_px: Array
    """(rows * columns, 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewFit:
    """How well one picture fits."""

    view: BoardView
    rms_px: float
    residuals_px: Array
    """(rows * columns, 2) found minus projected."""
    used: bool


@dataclass(frozen=True, slots=True, eq=False)
class Lens:
    """A lens fitted to pictures of a board."""

    camera: Camera
    """Its world is its own frame."""
    sigmas: dict[str, float]
    """Standard deviation of each of PARAMETERS, or FISHEYE_PARAMETERS; 0 for those that were held."""
    rms_px: float
    """Over the points of the pictures that were used."""
    fits: tuple[ViewFit, ...]
    """One for each picture with a board, in their order."""
    coverage: float
    """Share of the picture's cells (8 x 6) with a point of the board in them."""

    @property
    def rejected(self) -> tuple[str, ...]:
        """Names of the pictures that were left out."""
        return tuple(fit.view.name for fit in self.fits if not fit.used)


def calibrate_lens(
    views: Sequence[BoardView], board: Board, sensor: SensorSize, *, coefficients: int = 4, model: LensModel = "pinhole"
) -> Lens:
    """The lens that explains the views best (OpenCV's `calibrateCameraExtended`), outliers left out.

    `coefficients` counts the distortion coefficients of a pinhole, in OpenCV's order; the others stay 0. A fisheye lens
    has all four of its own.

    Raises:
        CalibrationError: with too few pictures, or a lens that is none.
    """
    if coefficients not in COEFFICIENTS:
        raise CalibrationError("no such lens model", expected=f"one of {COEFFICIENTS} coefficients", got=coefficients)
    used = list(range(len(views)))
    while True:
        _check_count(len(used), len(views))
        chosen = [views[k] for k in used]
        if model == "fisheye":
            fitted = fit_fisheye([view.uvs_px for view in chosen], board, sensor)
        else:
            fitted = _fit(chosen, board, sensor, coefficients)
        limit = max(OUTLIER_FROM_PX, OUTLIER_TIMES_MEDIAN * float(np.median(fitted.rms_px)))
        worst = int(np.argmax(fitted.rms_px))
        if fitted.rms_px[worst] <= limit:
            break
        used.pop(worst)  # one at a time: a bad picture makes its neighbours look bad too
    if _turns_back(fitted.camera):
        remedy = "take pictures with the board in the corners, or fit fewer --coefficients"
        raise CalibrationError("the lens model turns back inside the picture", remedy=remedy)
    return _report(views, used, fitted, board)


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    camera: Camera
    sigmas: dict[str, float]
    rms_px: Array
    """Per picture."""
    total_rms_px: float


def _fit(views: Sequence[BoardView], board: Board, sensor: SensorSize, coefficients: int) -> _Fitted:
    # Coefficients that are not asked for stay 0: those that few pictures leave open would take any value.
    flags = 0
    flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 if coefficients < 2 else 0
    flags |= cv2.CALIB_ZERO_TANGENT_DIST if coefficients < 4 else 0
    flags |= cv2.CALIB_FIX_K3 if coefficients < 5 else 0
    points = board.points_m.astype(np.float32)
    try:
        rms, K, distortion, _, _, deviations, _, per_view = cv2.calibrateCameraExtended(
            [points] * len(views),
            [view.uvs_px.astype(np.float32) for view in views],
            (sensor.width_px, sensor.height_px),
            np.eye(3),
            np.zeros(5),
            flags=flags,
        )
    except cv2.error as error:
        remedy = "tilt the board between the pictures, by 20 to 40 degrees about both axes"
        raise CalibrationError("the pictures fix no lens", remedy=remedy) from error
    sigmas: dict[str, float] = dict(zip(PARAMETERS, np.ravel(deviations)[:9].tolist(), strict=True))
    camera = Camera(sensor, np.asarray(K, np.float64), np.ravel(distortion)[:5].astype(np.float64), np.eye(4))
    return _Fitted(camera, sigmas, np.ravel(per_view).astype(np.float64), float(rms))


def _turns_back(camera: Camera) -> bool:
    if camera.model == "pinhole":
        return fold_radius(camera.distortion) < _corner_radius(camera)
    fold = float(camera.lens_row()[FOLD_ANGLE])
    if not math.isfinite(fold):
        return False
    powers = fold ** np.array([2, 4, 6, 8])
    return fold * (1 + float(powers @ camera.distortion)) < _corner_radius(camera)


def _report(views: Sequence[BoardView], used: list[int], fitted: _Fitted | FisheyeFit, board: Board) -> Lens:
    fits = []
    for k, view in enumerate(views):
        residuals = _residuals(view, board, fitted.camera)
        rms_px = float(np.sqrt((residuals**2).sum(axis=1).mean()))
        fits.append(ViewFit(view, rms_px, residuals, k in used))
    seen = np.concatenate([views[k].uvs_px for k in used])
    return Lens(fitted.camera, fitted.sigmas, fitted.total_rms_px, tuple(fits), coverage(seen, fitted.camera.sensor))


def _residuals(view: BoardView, board: Board, camera: Camera) -> Array:
    """Found minus projected (N, 2), the board where it fits this picture best."""
    R, t = board_pose(board, view.uvs_px, camera)
    return view.uvs_px - camera.project_from_camera(board.points_m @ R.T + t)


def _corner_radius(camera: Camera) -> float:
    """Pinhole radius of the picture's farthest corner, distortion aside."""
    size = np.array([camera.sensor.width_px - 1, camera.sensor.height_px - 1])
    reach = np.maximum(camera.K[:2, 2], size - camera.K[:2, 2]) / np.diag(camera.K)[:2]
    return float(np.hypot(*reach))


def _check_count(count: int, given: int) -> None:
    if count < PICTURES_AT_LEAST:
        left = "" if count == given else f", {given - count} did not fit together with the others"
        raise CalibrationError(
            "too few pictures with the whole board",
            expected=f"{PICTURES_AT_LEAST} or more",
            got=f"{count}{left}",
            remedy="take 15 to 30, tilted, near and far, also in the corners of the picture",
        )


YAML_SUFFIXES = (".yaml", ".yml")


def save_lens(path: Path, name: str, camera: Camera, *, notes: Mapping[str, float | str] | None = None) -> None:
    """Write one camera, replacing the file in one step. OpenCV's form has no names, but room for the notes.

    Raises:
        CalibrationError: if the file cannot be written.
    """
    if path.suffix.lower() not in YAML_SUFFIXES:
        save_calibration(path, {name: camera})
        return
    storage = cv2.FileStorage(".yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", camera.sensor.width_px)
    storage.write("image_height", camera.sensor.height_px)
    storage.write("camera_matrix", camera.K)
    storage.write("distortion_coefficients", camera.distortion[None])
    if camera.model == "fisheye":
        storage.write("distortion_model", "equidistant")
        storage.write("fisheye_model", 1)
    for key, value in (notes or {}).items():
        storage.write(key, value)
    try:
        replace_file(path, storage.releaseAndGetString().encode(), durable=True)
    except OSError as error:
        raise CalibrationError("cannot write the calibration", got=error.strerror, where=path) from error
