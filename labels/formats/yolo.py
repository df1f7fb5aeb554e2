"""YOLO text files, for detection (a box) and for pose (a box and the centre as its one keypoint).

One file a picture: empty where a person saw no ball, absent where nobody looked. Numbers are shares of the picture,
counted from its corner. What number means a ball is read from the list of names, see `labels.formats.class_names`.
"""

from __future__ import annotations

import re
from pathlib import Path

from core.errors import LabelError
from labels.formats.boxes import Box, box_of, losses_of_box
from labels.formats.class_names import find_ball_number
from labels.formats.exchange import (
    CLASS_NAME,
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    PictureTimes,
    count_losses,
    finite,
    picture_name,
    read_text,
    whole_number,
    write_text,
)
from labels.model import Label, LabelState

CLASSES = "classes.txt"
NO_LABELS = re.compile(
    r"\.|(classes|labels|predefined_classes|train|val|valid|test|autosplit_.*|readme.*|requirements)\.txt$",
    re.IGNORECASE,
)
"""Texts that stand beside those of the pictures, and hidden files."""
PARTLY_VISIBLE, WHOLLY_VISIBLE = 1, 2
"""Visibility of a keypoint: occluded, visible."""


def write_yolo(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """Write a text file of boxes for every picture."""
    return _write(labels, folder, options, pose=False)


def write_yolo_pose(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """Boxes with the ball's centre as a keypoint."""
    return _write(labels, folder, options, pose=True)


def _write(labels: LabelSet, folder: Path, options: ExportOptions, *, pose: bool) -> Exported:
    files = [write_text(folder / CLASSES, f"{CLASS_NAME}\n"), write_text(folder / "data.yaml", _yaml_text(pose))]
    losses: list[str] = ["provenance and covariance"] * bool(labels.labels)
    for label in labels.labels:
        box = (
            box_of(label, labels.sensor, options.default_radius_px)
            if label.state is not LabelState.OUT_OF_FRAME
            else None
        )
        losses += losses_of_box(label, box)
        kept = (
            (LabelState.VISIBLE, LabelState.PARTLY_OCCLUDED, LabelState.NO_BALL)
            if pose
            else (LabelState.VISIBLE, LabelState.NO_BALL)
        )
        losses += [f"state {label.state}"] if label.state not in kept else []
        text = "" if box is None else _line(label, box, labels, pose)
        files.append(write_text(folder / f"{picture_name(labels.camera, label.t_us)}.txt", text))
    return Exported(tuple(files), count_losses(losses))


def _line(label: Label, box: Box, labels: LabelSet, pose: bool) -> str:
    width, height = labels.sensor.width_px, labels.sensor.height_px
    xc, yc, w, h = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2, box.x1 - box.x0, box.y1 - box.y0
    text = f"0 {xc / width:.6f} {yc / height:.6f} {w / width:.6f} {h / height:.6f}"
    if pose:
        assert label.x_px is not None and label.y_px is not None, "a box has a position"
        x = min(max((label.x_px + HALF_PIXEL) / width, 0.0), 1.0)
        y = min(max((label.y_px + HALF_PIXEL) / height, 0.0), 1.0)
        text += f" {x:.6f} {y:.6f} {WHOLLY_VISIBLE if label.state is LabelState.VISIBLE else PARTLY_VISIBLE}"
    return f"{text}\n"


def _yaml_text(pose: bool) -> str:
    text = f"path: .\ntrain: .\nval: .\nnc: 1\nnames:\n  0: {CLASS_NAME}\n"
    return f"{text}kpt_shape: [1, 3]\nflip_idx: [0]\n" if pose else text


def read_yolo(path: Path, context: ImportContext) -> Imported:
    """Every text file of a folder, of boxes or of poses; without any there, those of the folders below."""
    collector = Collector()
    files = _texts_at(path, collector)
    times = context.pictures(file.name for file in files)
    balls: dict[Path, int | None] = {}
    for file in files:
        if file.parent not in balls:
            balls[file.parent] = find_ball_number(file.parent, context, collector)
        text = None if balls[file.parent] is None else read_text(file, collector)
        if text is not None:
            _read_file(text, file, balls[file.parent], times, context, collector)
    return collector.done()


def _texts_at(path: Path, collector: Collector) -> list[Path]:
    """The texts with labels, not those with lists of names or of pictures."""
    if path.is_file():
        return [path]
    places = (path.glob("*.txt"), path.rglob("*.txt")) if path.is_dir() else ()
    for place in places:
        found = sorted(file for file in place if file.is_file() and not NO_LABELS.match(file.name))
        if found:
            return found
    if not any((path / name).is_file() for name in (CLASSES, "data.yaml")):
        collector.reject(path, 1, "no .txt files here")
    return []


def _read_file(
    text: str, file: Path, ball: int | None, times: PictureTimes, context: ImportContext, collector: Collector
) -> None:
    lines = [(number, line.split()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not lines:
        with collector.entry(file, 1):
            collector.add(context.make(times.time_of(file.name), LabelState.NO_BALL), file, 1)
    for number, fields in lines:
        with collector.entry(file, number):
            if len(fields) not in (5, 6, 8):
                expected = "5 fields (6 with a confidence, 8 with a keypoint)"
                raise LabelError("not a line of YOLO", expected=expected, got=len(fields))
            if whole_number(fields[0], "the class") != ball:
                raise LabelError(f"class {fields[0]} is not {context.ball_class or CLASS_NAME!r}")
            collector.add(_label_of(fields, times.time_of(file.name), context), file, number)


def _label_of(fields: list[str], t_us: int, context: ImportContext) -> Label:
    numbers = [finite(field, f"field {number}") for number, field in enumerate(fields[1:], start=2)]
    if not all(0.0 <= number <= 1.0 for number in numbers[:4]):
        raise LabelError("outside the picture", expected="shares of it, 0 to 1", got=numbers[:4])
    width, height = context.sensor.width_px, context.sensor.height_px
    x, y, w, h = numbers[:4]
    radius = (w * width + h * height) / 4
    if not radius > 0:
        raise LabelError("the box is empty", got=numbers[:4])
    state = LabelState.VISIBLE
    if len(numbers) == 7 and numbers[6] > 0:
        x, y = numbers[4:6]
        state = LabelState.VISIBLE if numbers[6] >= WHOLLY_VISIBLE else LabelState.PARTLY_OCCLUDED
        # The box may be cut off by an edge; its larger side still shows the radius.
        radius = max(w * width, h * height) / 2
    return context.ball(t_us, state, x * width - HALF_PIXEL, y * height - HALF_PIXEL, radius)
