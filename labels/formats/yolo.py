"""YOLO text files: written for detection (a box) and for pose (a box and the centre as its one keypoint).

Read are also turned boxes and segments, as the circle of the polygon's area.

One file a picture: empty where a person saw no ball, absent where nobody looked. Numbers are shares of the picture,
counted from its corner. What number means a ball is read from the list of names, see `labels.formats.class_names`.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np

from core.errors import LabelError
from labels.formats.boxes import Box, box_of, circle_of_polygon, losses_of_box
from labels.formats.class_names import BallClass, find_ball_class
from labels.formats.exchange import (
    CLASS_NAME,
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    count_losses,
    finite,
    picture_name,
    read_text,
    whole_number,
    write_text,
)
from labels.formats.labelled_pictures import SAME_SHAPE, DrawnShape, Picture, Place, add_pictures
from labels.formats.picture_files import PictureFiles
from labels.model import Label, LabelState

CLASSES = "classes.txt"
NO_LABELS = re.compile(
    r"\.|(classes|names|labels|predefined_classes|train|val|valid|test|autosplit_.*|readme.*|requirements)\.txt$",
    re.IGNORECASE,
)
"""Texts that stand beside those of the pictures, and hidden files."""
OUTSIDE = 0.5
"""Share of the picture by which the corner of a polygon may lie beside it (ultralytics/yolov5#10632)."""
CVAT_FOLDER = re.compile(r"obj_\w+_data")
LONGEST_BOX = 10.0
LEAST_CONFIDENCE = 0.25
"""Ultralytics' own `conf`: detections below it are not shown."""
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
    balls: dict[Path, BallClass | None] = {}
    texts: dict[Path, str] = {}
    for file in files:
        if file.parent not in balls:
            balls[file.parent] = find_ball_class(file.parent, context, collector)
        text = None if balls[file.parent] is None else read_text(file, collector)
        if text is not None:
            texts[file] = text
    for folder, ball in balls.items():
        if ball is not None and not _classes_fit(folder, ball, texts, collector):
            balls[folder] = None
    beside = PictureFiles()
    pictures: list[Picture] = []
    confidences: list[float] = []
    for file in files:
        name = str(file.relative_to(path)) if file != path else file.name
        ball, text = balls[file.parent], texts.get(file)
        if ball is None or text is None:  # its name still tells what the numbers of the others mean
            pictures.append(Picture(file=file, line=1, names=(name,)))
        else:
            pictures.append(_picture_of(text, file, name, ball, beside, confidences, context))
    add_pictures(pictures, context, collector)
    if confidences:
        low = sum(confidence < LEAST_CONFIDENCE for confidence in confidences)
        text = f"{len(confidences)} boxes are detections, with confidences from {min(confidences):g}"
        remedy = "look at the labels, or write the files with a higher conf"
        collector.note(f"{text}, {low} of them below {LEAST_CONFIDENCE}; all became labels: {remedy}")
    return collector.done()


def _picture_of(
    text: str,
    file: Path,
    name: str,
    ball: BallClass,
    beside: PictureFiles,
    confidences: list[float],
    context: ImportContext,
) -> Picture:
    """The picture of a text; the confidences of its boxes are added to `confidences` as they become labels."""
    lines = [(number, line.split()) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]

    def whole(place: Place) -> Label | None:
        _check_shape(beside.size_beside(file), context)
        if lines:
            return None
        # CVAT writes an empty text also where nobody looked or a shape has no place in YOLO, in folders of such a name
        # (cvat-ai/cvat#7643, #8322).
        unsure = CVAT_FOLDER.fullmatch(file.parent.name) is not None or context.empty_pictures is not None
        return context.unannotated(place.t_us) if unsure else context.make(place.t_us, LabelState.NO_BALL)

    shapes = [
        DrawnShape(number, partial(_label_of_line, fields, ball, confidences, context)) for number, fields in lines
    ]
    return Picture(file=file, line=1, names=(name,), whole=whole, shapes=shapes)


def _label_of_line(
    fields: list[str], ball: BallClass, confidences: list[float], context: ImportContext, place: Place
) -> Label:
    _refuse_rows_of_mot(fields)
    if whole_number(fields[0], "the class") != ball.number:
        raise LabelError(f"class {fields[0]} is not {context.ball_class or CLASS_NAME!r}")
    numbers = [finite(field, f"field {place}") for place, field in enumerate(fields[1:], start=2)]
    if not all(-OUTSIDE <= number <= 1.0 + OUTSIDE for number in numbers[:4]):
        remedy = "are these pixels, where shares belong?" if max(numbers) > 2 else ""
        raise LabelError("outside the picture", expected="shares, 0 to 1", got=numbers[:4], remedy=remedy)
    label = _label_of(numbers, ball, place.t_us, context)
    confidences += _confidence_in(numbers, ball)
    return label


def _confidence_in(numbers: list[float], ball: BallClass) -> list[float]:
    """The confidence in what follows the class on a line that is read; empty without one."""
    keypoint, count = ball.keypoint_numbers, len(numbers)
    if keypoint is None:
        keypoint = 3 if count == 7 else 0
    if keypoint:
        return numbers[-1:] if count == 5 + keypoint else []
    # A box may have the number of its track after the confidence; of a polygon an odd number is left over.
    track = count == 6 and numbers[5] != 0 and numbers[5].is_integer()
    return numbers[4:5] if track else numbers[-1:] if count % 2 else []


def _check_shape(size: tuple[int, int] | None, context: ImportContext) -> None:
    """Hold the picture that lies beside a text against the sensor: shares of a padded picture are none of the sensor.

    Labels of padded pictures were 79 px off: ultralytics/yolov5#4952.

    Raises:
        LabelError: if it has another shape, and nobody says that it is stretched.
    """
    if size is None or context.scale_pictures:
        return
    width, height = context.sensor.width_px, context.sensor.height_px
    if abs(size[0] * height / (size[1] * width) - 1) > SAME_SHAPE:
        raise LabelError(
            "the picture has another shape than the sensor",
            expected=str(context.sensor),
            got=f"{size[0]}x{size[1]}",
            remedy="take the pictures without padding; --scale-pictures if they were stretched",
        )


def _classes_fit(folder: Path, ball: BallClass, texts: dict[Path, str], collector: Collector) -> bool:
    """Whether the classes in the texts of a folder do not count from 1 while the list counts from 0 (obss/sahi#524)."""
    numbers = set()
    for file, text in texts.items():
        if file.parent == folder:
            starts = (line.split(maxsplit=1)[0] for line in text.splitlines() if line.strip())
            numbers |= {int(start) for start in starts if start.isdecimal() and len(start) < 7}
    if ball.classes is None or not numbers or min(numbers) == 0 or max(numbers) != ball.classes:
        return True
    what = "classes seem to count from 1, and the list of names from 0"
    got, expected = f"{min(numbers)} to {max(numbers)}", f"0 to {ball.classes - 1}"
    error = LabelError(what, expected=expected, got=got, remedy="which is the ball? --ball-class N")
    collector.reject(folder, 1, error)
    return False


def _texts_at(path: Path, collector: Collector) -> list[Path]:
    """The texts with labels, not those with lists of names or of pictures."""
    if path.is_file():
        return [path]
    places = (path.iterdir(), path.rglob("*")) if path.is_dir() else ()
    for place in places:
        texts = (file for file in place if file.suffix.lower() == ".txt" and file.is_file())
        found = sorted(file for file in texts if not NO_LABELS.match(file.name))
        if found:
            return found
    if not any((path / name).is_file() for name in (CLASSES, "data.yaml")):
        collector.reject(path, 1, "no .txt files here")
    return []


def _refuse_rows_of_mot(fields: list[str]) -> None:
    """Raises LabelError for a row of MOT: frame, track, left, top, width and height in pixels, perhaps four more."""
    if "," in fields[0] or (len(fields) == 10 and fields[-3:] == ["-1"] * 3):
        what = "not a line of YOLO; it looks like a track of MOT"
        expected = "class, x, y, width and height, with spaces between"
        remedy = "a table with the columns frame, x and y (the centre, px) is read by --format csv"
        raise LabelError(what, expected=expected, got=" ".join(fields)[:60], remedy=remedy)


def _label_of(numbers: list[float], ball: BallClass, t_us: int, context: ImportContext) -> Label:
    """From what follows the class: a box, with a confidence or a keypoint, or the corners of a polygon."""
    width, height = context.sensor.width_px, context.sensor.height_px
    count = len(numbers)
    state = LabelState.VISIBLE
    keypoint = ball.keypoint_numbers
    if keypoint is None:  # not said: three belong to a keypoint, two may be the third corner of a polygon
        keypoint = 3 if count == 7 else 0
    if keypoint and count in (4 + keypoint, 5 + keypoint):
        box, point = numbers[:4], numbers[4 : 4 + keypoint]
    elif not keypoint and (count in (4, 5) or (count == 6 and numbers[5] != 0 and numbers[5].is_integer())):
        # A confidence and the number of a track may follow: from 1, or -1 without a track (ultralytics/ultralytics
        # #1357, #1358). A triangle at the lower edge that is read so has a box of half the picture, which is refused.
        box, point = numbers[:4], []
    elif count >= 6 and not keypoint and (count % 2 == 0 or count >= 9):  # odd: a confidence follows
        return _label_of_polygon(numbers[: count - count % 2], t_us, context)
    else:
        expected = (
            "a class and 4 numbers (5 with a confidence, 6 with a track), those with a keypoint, or 3 and more corners"
        )
        raise LabelError("not a line of YOLO", expected=expected, got=f"{count} numbers")
    x, y, w, h = box
    if count == 5 and _is_long(w * width, h * height) and not _is_long(numbers[3] * width, numbers[4] * height):
        raise LabelError("the confidence seems to stand first", expected="class x y w h confidence", got=numbers)
    radius = (w * width + h * height) / 4
    if not all(0.0 <= number <= 1.0 for number in box):
        raise LabelError("outside the picture", expected="shares, 0 to 1", got=box)
    if not min(w, h) > 0:
        raise LabelError("the box is empty", got=box)
    if point and (len(point) == 2 or point[2] > 0):
        if not all(0 <= share <= 1 for share in point[:2]):
            what = f"the {count + 1} columns are no box with a keypoint"
            expected = "class, box, x and y as shares, 0 to 1"
            raise LabelError(what, expected=expected, got=numbers, remedy="leave out what is neither box nor keypoint")
        if abs(point[0] - x) > 2 * w or abs(point[1] - y) > 2 * h:
            raise LabelError("the keypoint lies far from its box", got=numbers)
        x, y = point[:2]
        whole = len(point) == 2 or point[2] >= WHOLLY_VISIBLE
        state = LabelState.VISIBLE if whole else LabelState.PARTLY_OCCLUDED
        # The box may be cut off by an edge; its larger side still shows the radius.
        radius = max(w * width, h * height) / 2
    return context.ball(t_us, state, x * width - HALF_PIXEL, y * height - HALF_PIXEL, radius)


def _is_long(first_px: float, second_px: float) -> bool:
    """Whether one side is so much longer that no ball, blurred by its motion, fills the box."""
    return max(first_px, second_px) > LONGEST_BOX * min(first_px, second_px)


def _label_of_polygon(numbers: list[float], t_us: int, context: ImportContext) -> Label:
    """The centre and the radius of a circle with the area of a polygon, of a segment or of a turned box."""
    if not all(-OUTSIDE <= number <= 1.0 + OUTSIDE for number in numbers):
        raise LabelError("outside the picture", expected="shares, 0 to 1", got=numbers[:8])
    corners = np.array(numbers).reshape(-1, 2) * (context.sensor.width_px, context.sensor.height_px)
    try:
        x, y, radius = circle_of_polygon(corners)
        return context.ball(t_us, LabelState.VISIBLE, x - HALF_PIXEL, y - HALF_PIXEL, radius)
    except LabelError as error:
        if len(numbers) != 6:
            raise
        what = "the 7 columns are neither a box with a confidence and the number of a track nor a triangle"
        expected = "class x y w h confidence track, the last a whole number; or class and three corners"
        raise LabelError(what, expected=expected, got=numbers) from error
