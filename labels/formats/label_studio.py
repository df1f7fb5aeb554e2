"""Label Studio's JSON and JSON-MIN: regions in percent of the picture, counted from its corner.

A task that somebody submitted without a region is a picture without a ball; one without an annotation says nothing.
Skipped annotations and predictions are left out. What a region cannot say stands in the task's `data`, which is free.
"""

from __future__ import annotations

import json
import math
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from core.errors import LabelError
from core.files import file_stem
from labels.formats.boxes import Box, box_of, circle_of_polygon, losses_of_box
from labels.formats.documents import JsonObject, parse_json
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
    write_text,
)
from labels.formats.labelled_pictures import DrawnShape, Picture, Place, read_pictures, stated_size
from labels.model import Label, LabelState

PICTURE_KEYS: Final = ("image", "img", "picture", "frame", "photo")
"""Keys in the data of a task: what its picture is called; else the only text with the ending of one."""
ENDINGS: Final = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
SHAPES: Final = ("rectanglelabels", "ellipselabels", "keypointlabels", "polygonlabels")
OWN: Final = "rallyscope"
PERCENT: Final = 100.0


def write_label_studio(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`<camera>.json` in the folder: a task for each label."""
    losses: list[str] = ["provenance and covariance"] * bool(labels.labels)
    tasks: list[dict[str, object]] = []
    for number, label in enumerate(labels.labels, start=1):
        box = box_of(label, labels.sensor, options.default_radius_px)
        losses += losses_of_box(label, box)
        name = picture_name(labels.camera, label.t_us)
        own = {"state": label.state.value, "x_px": label.x_px, "y_px": label.y_px, "r_px": label.r_px}
        regions = [] if box is None else [_region(f"r{number}", box, labels)]
        annotation = {"id": number, "result": regions, "was_cancelled": False, "ground_truth": False}
        data = {"image": f"{name}.png", OWN: own}
        tasks.append({"id": number, "data": data, "annotations": [annotation], "predictions": []})
    text = json.dumps(tasks, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    return Exported((write_text(folder / f"{file_stem(labels.camera)}.json", text),), count_losses(losses))


def _region(name: str, box: Box, labels: LabelSet) -> dict[str, object]:
    width, height = labels.sensor.width_px, labels.sensor.height_px
    value = {
        "x": PERCENT * box.x0 / width,
        "y": PERCENT * box.y0 / height,
        "width": PERCENT * (box.x1 - box.x0) / width,
        "height": PERCENT * (box.y1 - box.y0) / height,
        "rotation": 0,
        "rectanglelabels": [CLASS_NAME],
    }
    shape = {"id": name, "type": "rectanglelabels", "from_name": "label", "to_name": "image", "image_rotation": 0}
    return {**shape, "original_width": width, "original_height": height, "value": value}


def read_label_studio(path: Path, context: ImportContext) -> Imported:
    """Every JSON file of a folder, or one."""
    return read_pictures(path, ".json", context, _pictures_in)


def _pictures_in(text: str, file: Path, context: ImportContext, collector: Collector) -> list[Picture]:
    content = parse_json(text)
    found: list[Picture] = []
    for number, item in enumerate(content if isinstance(content, list) else [content]):
        if not isinstance(item, JsonObject):
            collector.reject(file, 1, f"task {number} is not an object")
            continue
        with collector.entry(file, item.line):
            found.append(_picture_of(item, file, context, collector))
    return found


def _picture_of(item: JsonObject, file: Path, context: ImportContext, collector: Collector) -> Picture:
    data = item.get("data")
    picture = _picture_in(data if isinstance(data, dict) else item)
    regions = _regions_of(item, picture, collector)
    own = data.get(OWN) if isinstance(data, dict) else None
    return Picture(
        file=file,
        line=item.line,
        names=(picture,),
        sizes=[_stated_size(region) for region in regions or ()],
        whole=partial(_whole, own, regions, context),
        shapes=[DrawnShape(region.line, partial(_label_in_picture, region, context)) for region in regions or ()],
    )


def _regions_of(item: JsonObject, picture: str, collector: Collector) -> list[JsonObject] | None:
    """The regions of a task; None: nobody submitted an annotation.

    Raises:
        LabelError: if it is no task, or whose annotation counts cannot be told.
    """
    if not isinstance(item.get("data"), dict):  # JSON-MIN: regions by the name of the control
        lists = [value for value in item.values() if isinstance(value, list) and all(map(_is_region, value))]
        regions = [region for value in lists for region in value]
        return regions if regions or "annotation_id" in item else None
    annotations = item.get("annotations", item.get("completions"))
    if not isinstance(annotations, list):
        raise LabelError("not a task of Label Studio", expected="a list of annotations")
    submitted = [one for one in annotations if isinstance(one, JsonObject) and not one.get("was_cancelled")]
    if len(submitted) > 1:
        raise LabelError("several annotations of one task: whose counts?", got=f"{len(submitted)} of {picture!r}"[:200])
    if item.get("predictions"):
        collector.note("predictions are left out: only annotations are taken")
    regions = submitted[0].get("result") if submitted else None
    if submitted and not (isinstance(regions, list) and all(isinstance(one, JsonObject) for one in regions)):
        raise LabelError("an annotation without a list of results")
    return regions if isinstance(regions, list) else None


def _is_region(value: object) -> bool:
    return isinstance(value, JsonObject) and any(name in value for name in SHAPES)


def _picture_in(fields: dict[str, object]) -> str:
    texts = {key: value for key, value in fields.items() if isinstance(value, str)}
    named = [texts[key] for key in PICTURE_KEYS if key in texts]
    likely = named or [text for text in texts.values() if text.split("?")[0].lower().endswith(ENDINGS)]
    if len(likely) != 1:
        raise LabelError("which picture is it?", expected="one name of a picture", got=f"{len(likely)} in the task")
    # Local files are named behind "?d=", uploads may have a key behind "?".
    text = likely[0]
    return text.split("?d=", 1)[1] if "?d=" in text else text.split("?", 1)[0]


def _stated_size(region: JsonObject) -> tuple[object, object]:
    return region.get("original_width"), region.get("original_height")


def _whole(own: object, regions: list[JsonObject] | None, context: ImportContext, place: Place) -> Label | None:
    """What our own export says of a task whose regions are unchanged, and the label of one without regions."""
    if isinstance(own, dict) and regions is not None:
        label = _own_label(own, place.t_us, context)
        if _is_unchanged(label, regions, context):
            return label
    if regions:
        return None
    submitted = regions is not None and context.empty_pictures is None
    return context.make(place.t_us, LabelState.NO_BALL) if submitted else context.unannotated(place.t_us)


def _label_in_picture(region: JsonObject, context: ImportContext, place: Place) -> Label:
    place.scaling.of(stated_size(*_stated_size(region)))  # regions are in percent: only a foreign size is refused
    return _label_of(region, place.t_us, context)


def _is_unchanged(label: Label, regions: list[JsonObject], context: ImportContext) -> bool:
    """Whether the regions of a task are still those that we wrote of a label."""
    box = box_of(label, context.sensor, ExportOptions().default_radius_px)
    if box is None or len(regions) != 1:
        return box is None and not regions
    value = regions[0].get("value")
    width, height = context.sensor.width_px, context.sensor.height_px
    ours = (box.x0 / width, box.y0 / height, (box.x1 - box.x0) / width, (box.y1 - box.y0) / height)
    sides = [value.get(name) for name in ("x", "y", "width", "height")] if isinstance(value, dict) else []
    numbers = [side for side in sides if isinstance(side, (int, float))]
    return len(numbers) == 4 and np.allclose(numbers, PERCENT * np.array(ours), atol=1e-6)


def _own_label(own: dict[str, object], t_us: int, context: ImportContext) -> Label:
    x, y, r = (None if own.get(name) is None else finite(own[name], name) for name in ("x_px", "y_px", "r_px"))
    return context.make(t_us, LabelState(str(own.get("state"))), x, y, r)


def _label_of(region: JsonObject, t_us: int, context: ImportContext) -> Label:
    if finite(region.get("image_rotation") or 0, "image_rotation") % 360:
        # Its shares are then of the turned picture, its size is that before the turn.
        remedy = "turn the picture back in Label Studio, and export again"
        raise LabelError(
            "the picture was turned while it was labelled", got=f"{region['image_rotation']} degrees", remedy=remedy
        )
    inner = region.get("value")
    value = inner if isinstance(inner, dict) else region
    kind = next((name for name in SHAPES if name in value), None)
    if kind is None:
        expected = "a rectangle, an ellipse, a keypoint or a polygon with a label"
        raise LabelError("not a region that can be a ball", expected=expected, got=str(region.get("type"))[:80])
    names = value[kind]
    if not isinstance(names, list) or len(names) != 1 or not context.is_ball(str(names[0])):
        raise LabelError(f"label {str(names)[:80]} is not {context.ball_class or CLASS_NAME!r}")
    width, height = context.sensor.width_px / PERCENT, context.sensor.height_px / PERCENT
    if kind == "polygonlabels":
        corners = _corners(value.get("points"))
        x, y, radius = circle_of_polygon(np.array(corners) * (width, height))
        return context.ball(t_us, LabelState.VISIBLE, x - HALF_PIXEL, y - HALF_PIXEL, radius)
    x, y = finite(value.get("x"), "x") * width, finite(value.get("y"), "y") * height
    radius: float | None = None
    if kind == "ellipselabels":
        rx, ry = finite(value.get("radiusX"), "radiusX") * width, finite(value.get("radiusY"), "radiusY") * height
        if min(rx, ry) <= 0:
            raise LabelError("the ellipse is empty", got=(rx, ry))
        radius = (rx + ry) / 2
    elif kind == "rectanglelabels":
        w, h = finite(value.get("width"), "width") * width, finite(value.get("height"), "height") * height
        if w == 0 or h == 0:
            raise LabelError("the box is empty", got=(w, h))
        # A rectangle of a prediction that was changed may be drawn to the left or upwards: its sides are negative
        # (HumanSignal/label-studio#3140).
        turn = math.radians(finite(value.get("rotation", 0), "rotation"))  # round the upper left corner
        x += w / 2 * math.cos(turn) - h / 2 * math.sin(turn)
        y += w / 2 * math.sin(turn) + h / 2 * math.cos(turn)
        radius = (abs(w) + abs(h)) / 4
    return context.ball(t_us, LabelState.VISIBLE, x - HALF_PIXEL, y - HALF_PIXEL, radius)


def _corners(points: object) -> list[list[float]]:
    pairs = (
        [point for point in points if isinstance(point, list) and len(point) == 2] if isinstance(points, list) else []
    )
    if len(pairs) < 3 or len(pairs) != len(points if isinstance(points, list) else ()):
        raise LabelError("not a polygon", got=str(points)[:80])
    return [[finite(number, "a corner") for number in pair] for pair in pairs]
