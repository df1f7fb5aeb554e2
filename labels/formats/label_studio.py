"""Label Studio's JSON and JSON-MIN: regions in percent of the picture, counted from its corner.

A task that somebody submitted without a region is a picture without a ball; one without an annotation says nothing.
Skipped annotations and predictions are left out. What a region cannot say stands in the task's `data`, which is free.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from core.errors import LabelError
from labels.formats.boxes import Box, box_of, circle_of_polygon, losses_of_box
from labels.formats.exchange import (
    CLASS_NAME,
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    PictureScaling,
    PictureTimes,
    SamePictures,
    count_losses,
    files_at,
    finite,
    picture_name,
    read_text,
    stated_size,
    write_text,
)
from labels.formats.json_lines import JsonError, JsonObject, parse_json
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
    stem = picture_name(labels.camera, 0).rsplit("_t", 1)[0]
    return Exported((write_text(folder / f"{stem}.json", text),), count_losses(losses))


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


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """One picture, and what was annotated in it."""

    file: Path
    line: int
    picture: str
    own: object
    """What our own export says of it."""
    regions: list[JsonObject] | None
    """None: nobody submitted an annotation."""


def read_label_studio(path: Path, context: ImportContext) -> Imported:
    """Every JSON file of a folder, or one."""
    collector = Collector()
    tasks: list[_Task] = []
    same = SamePictures()
    for file in files_at(path, ".json", collector):
        found = _tasks_in(file, collector)
        same.add(file, (task.picture for task in found))
        tasks += found
    tasks = [task for task in tasks if task.file in {f for f in {t.file for t in tasks} if same.accept(f, collector)}]
    times = context.pictures(task.picture for task in tasks)
    sizes = (_size_of(region) for task in tasks for region in task.regions or ())
    scaling = context.scaling(sizes, collector)
    for task in tasks:
        _read_task(task, times, scaling, context, collector)
    return collector.done()


def _tasks_in(file: Path, collector: Collector) -> list[_Task]:
    text = read_text(file, collector)
    if text is None:
        return []
    try:
        content = parse_json(text)
    except JsonError as error:
        collector.reject(file, error.line, error)
        return []
    items = content if isinstance(content, list) else [content]
    found: list[_Task] = []
    for number, item in enumerate(items):
        if not isinstance(item, JsonObject):
            collector.reject(file, 1, f"task {number} is not an object")
            continue
        with collector.entry(file, item.line):
            found.append(_task_of(item, file, collector))
    return found


def _task_of(item: JsonObject, file: Path, collector: Collector) -> _Task:
    data = item.get("data")
    fields = data if isinstance(data, dict) else item
    picture = _picture_in(fields)
    if not isinstance(data, dict):  # JSON-MIN: regions by the name of the control
        lists = [value for value in item.values() if isinstance(value, list) and all(map(_is_region, value))]
        regions = [region for value in lists for region in value]
        known = bool(regions) or "annotation_id" in item
        return _Task(file, item.line, picture, None, regions if known else None)
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
    return _Task(file, item.line, picture, data.get(OWN), regions if isinstance(regions, list) else None)


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


def _size_of(region: JsonObject) -> tuple[float, float] | None:
    try:
        return stated_size(region.get("original_width"), region.get("original_height"))
    except LabelError:
        return None


def _read_task(
    task: _Task, times: PictureTimes, scaling: PictureScaling, context: ImportContext, collector: Collector
) -> None:
    with collector.entry(task.file, task.line):
        if isinstance(task.own, dict) and task.regions is not None:
            label = _own_label(task.own, times.time_of(task.picture), context)
            if _is_unchanged(label, task.regions, context):
                collector.add(label, task.file, task.line)
                return
        if not task.regions:
            t_us = times.time_of(task.picture)
            submitted = task.regions is not None and context.empty_pictures is None
            label = context.make(t_us, LabelState.NO_BALL) if submitted else context.unannotated(t_us)
            collector.add(label, task.file, task.line)
        for region in task.regions or ():
            with collector.entry(task.file, region.line):
                scaling.of(stated_size(region.get("original_width"), region.get("original_height")))
                label = _label_of(region, times.time_of(task.picture), context)
                collector.add(label, task.file, region.line)


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
        # A rectangle of a prediction that was changed may be drawn to the left or upwards: its sides are negative.
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
