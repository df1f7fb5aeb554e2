"""Do labels come back from every exchange format, read by us and, where they are installed, by other tools?"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from labels.formats import FORMATS, ExportOptions, ImportContext, LabelSet
from labels.formats.exchange import picture_name

Array = NDArray[np.float64]
ROUNDED_PX: Final = 0.71
"""The farthest that rounding to whole pixels moves a centre."""
EXACT_PX: Final = 0.01
ROUNDED: Final = ("tracknet", "openttgames", "voc by LabelImg", "yolo by LabelImg")


@dataclass(frozen=True, slots=True)
class ExportCheck:
    """One reader of one format."""

    name: str
    balls: int
    """That it found."""
    worst_px: float

    def fails(self, balls: int) -> bool:
        """Whether something is missing or farther off than the format's rounding."""
        allowed = ROUNDED_PX if self.name in ROUNDED else EXACT_PX
        return self.balls != balls or not self.worst_px <= allowed


def check_exports(labels: LabelSet, folder: Path) -> tuple[ExportCheck, ...]:
    """Write every format and read it again, by every reader there is; all labels must have a visible ball."""
    truth = {label.t_us: (float(label.x_px or 0), float(label.y_px or 0)) for label in labels.labels}
    checks = []
    for name, kind in FORMATS.items():
        out = folder / (f"{name}.h5" if name == "hdf5" else name)
        kind.write(labels, out, ExportOptions())
        context = ImportContext(labels.sensor, np.array(sorted(truth)), "check", labels.camera)
        found = kind.read(out, context)
        centres = {label.t_us: (label.x_px, label.y_px) for label in found.labels if label.x_px is not None}
        checks.append(_compare(name, centres, truth))
    for name, (package, read) in OTHERS.items():
        if importlib.util.find_spec(package) is not None:
            checks.append(_compare(name, read(labels, folder), truth))
    return tuple(checks)


def _compare(name: str, found: dict, truth: dict[int, tuple[float, float]]) -> ExportCheck:
    errors = [float(np.hypot(found[t][0] - x, found[t][1] - y)) for t, (x, y) in truth.items() if t in found]
    return ExportCheck(name, len(errors), max(errors, default=float("inf")))


def _voc_by_labelimg(labels: LabelSet, folder: Path) -> dict[int, Array]:
    from libs.pascal_voc_io import PascalVocReader  # pyright: ignore[reportMissingImports]

    return {
        label.t_us: np.mean(shapes[0][1], axis=0) - 0.5
        for label in labels.labels
        if (shapes := PascalVocReader(str(folder / "voc" / f"{_name(labels, label.t_us)}.xml")).get_shapes())
    }


def _yolo_by_labelimg(labels: LabelSet, folder: Path) -> dict[int, Array]:
    from libs.yolo_io import YoloReader  # pyright: ignore[reportMissingImports]

    size = labels.sensor
    picture = SimpleNamespace(height=lambda: size.height_px, width=lambda: size.width_px, isGrayscale=lambda: True)
    return {
        label.t_us: np.mean(shapes[0][1], axis=0) - 0.5
        for label in labels.labels
        if (shapes := YoloReader(str(folder / "yolo" / f"{_name(labels, label.t_us)}.txt"), picture).get_shapes())
    }


def _coco_by_pycocotools(labels: LabelSet, folder: Path) -> dict[int, Array]:
    from pycocotools.coco import COCO

    (file,) = (path for path in (folder / "coco").glob("*.json"))
    with contextlib.redirect_stdout(io.StringIO()):  # it says how it is getting on
        coco = COCO(str(file))
    times = {_name(labels, label.t_us): label.t_us for label in labels.labels}
    found = {}
    for entry in coco.loadAnns(coco.getAnnIds()):
        picture = Path(coco.loadImgs(entry["image_id"])[0]["file_name"]).stem
        found[times[picture]] = np.array(entry["keypoints"][:2]) - 0.5  # pyright: ignore[reportGeneralTypeIssues]
    return found


def _name(labels: LabelSet, t_us: int) -> str:
    return picture_name(labels.camera, t_us)


OTHERS: Final[dict[str, tuple[str, Callable[[LabelSet, Path], dict]]]] = {
    "voc by LabelImg": ("libs", _voc_by_labelimg),
    "yolo by LabelImg": ("libs", _yolo_by_labelimg),
    "coco by pycocotools": ("pycocotools", _coco_by_pycocotools),
}
"""Readers of other tools: the package that must be there, and how it is asked."""


def checks_text(checks: tuple[ExportCheck, ...]) -> str:
    """Each reader with its worst error, as one line."""
    return json.dumps({check.name: round(check.worst_px, 3) for check in checks})
