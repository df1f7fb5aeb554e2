"""COCO keypoints: one JSON file; the ball is a category with its centre as the one keypoint.

Boxes and keypoints count from the picture's corner. Ids start at 1 and areas are above 0: evaluation tools take an id
of 0 for "no match" and score an area of 0 as nothing. A reviewed picture without a ball has no annotation, but is
listed. For pycocotools set `params.kpt_oks_sigmas` to one number: its default is for 17 joints of a person.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

from core.errors import LabelError
from labels.formats.boxes import HALF_PIXEL, Box, box_of, losses_of_box
from labels.formats.exchange import (
    CLASS_NAME,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    count_losses,
    files_at,
    finite,
    picture_name,
    read_text,
    write_text,
)
from labels.formats.json_lines import JsonError, JsonObject, parse_json
from labels.model import Label, LabelState

OCCLUDED, VISIBLE = 1, 2


def write_coco(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`<camera>.json` in the folder."""
    images, annotations, losses = [], [], ["provenance and covariance"] * bool(labels.labels)
    width, height = labels.sensor.width_px, labels.sensor.height_px
    for image_id, label in enumerate(labels.labels, start=1):
        name = picture_name(labels.camera, label.t_us)
        image = {"id": image_id, "file_name": f"{name}.png", "width": width, "height": height}
        images.append({**image, "t_us": label.t_us, "state": label.state.value})
        box = box_of(label, labels.sensor, options.default_radius_px)
        losses += losses_of_box(label, box)
        if box is not None:
            annotations.append(_annotation(len(annotations) + 1, image_id, label, box))
    info = {"description": "Ball centres. Coordinates count from the outer corner of the first pixel."}
    document = {
        "info": {**info, "recording": labels.recording_uuid, "camera": labels.camera, "annotator": labels.annotator},
        "licenses": [],
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": CLASS_NAME, "supercategory": "", "keypoints": ["centre"], "skeleton": []}],
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    return Exported((write_text(folder / f"{_stem(labels)}.json", text),), count_losses(losses))


def _stem(labels: LabelSet) -> str:
    return picture_name(labels.camera, 0).rsplit("_t", 1)[0]


def _annotation(number: int, image_id: int, label: Label, box: Box) -> dict[str, object]:
    assert label.x_px is not None and label.y_px is not None, "a box has a position"
    w, h = box.x1 - box.x0, box.y1 - box.y0
    visibility = VISIBLE if label.state is LabelState.VISIBLE else OCCLUDED
    return {
        "id": number,
        "image_id": image_id,
        "category_id": 1,
        "bbox": [box.x0, box.y0, w, h],
        "area": w * h if label.r_px is None else max(math.pi / 4 * w * h, 1e-3),
        "iscrowd": 0,
        "keypoints": [label.x_px + HALF_PIXEL, label.y_px + HALF_PIXEL, visibility],
        "num_keypoints": 1,
        "state": label.state.value,
        **({} if label.r_px is None else {"r_px": label.r_px}),
    }


def read_coco(path: Path, context: ImportContext) -> Imported:
    """Every JSON file of a folder, or one."""
    collector = Collector()
    for file in files_at(path, ".json", collector):
        text = read_text(file, collector)
        if text is None:
            continue
        try:
            document = parse_json(text)
        except JsonError as error:
            collector.reject(file, error.line, error)
            continue
        lists = [document.get(name) if isinstance(document, dict) else None for name in ("images", "annotations")]
        if not isinstance(document, dict) or not all(isinstance(items, list) for items in lists):
            collector.reject(file, 1, "not a COCO file; expected lists of images and annotations")
            continue
        _read_document(document, file, context, collector)
    return collector.done()


def _read_document(document: dict, file: Path, context: ImportContext, collector: Collector) -> None:
    balls: set[object] = set()
    for entry in _objects(document.get("categories", []), "category", file, collector):
        if entry.get("name") == CLASS_NAME and isinstance(entry.get("id"), (int, str)):
            balls.add(entry["id"])
    images: dict[object, JsonObject] = {}
    for image in _objects(document["images"], "image", file, collector):
        with collector.entry(file, image.line):
            if not isinstance(image["id"], (int, str)) or image["id"] in images:
                raise LabelError("an image id that is missing, odd or used twice", got=image["id"])
            images[image["id"]] = image
    used: set[object] = set()
    for entry in _objects(document["annotations"], "annotation", file, collector):
        with collector.entry(file, entry.line):
            image_id = entry["image_id"]
            if image_id not in images:
                raise LabelError("an annotation of an image that is not listed", got=image_id)
            used.add(image_id)
            if entry["category_id"] not in balls:
                raise LabelError(f"category {entry['category_id']!r} is not {CLASS_NAME!r}")
            collector.add(_label_of(entry, _time_of(images[image_id], context), context), file, entry.line)
    for image_id, image in images.items():
        if image_id not in used:
            with collector.entry(file, image.line):
                state = LabelState(str(image.get("state", LabelState.NO_BALL)))
                collector.add(context.make(_time_of(image, context), state), file, image.line)


def _objects(items: object, kind: str, file: Path, collector: Collector) -> list[JsonObject]:
    found = []
    for number, item in enumerate(items if isinstance(items, list) else [items]):
        if isinstance(item, JsonObject):
            found.append(item)
        else:
            collector.reject(file, 1, f"{kind} {number} is not an object")
    return found


def _time_of(image: JsonObject, context: ImportContext) -> int:
    t_us = image.get("t_us")
    return t_us if isinstance(t_us, int) else context.time_of(str(image["file_name"]))


def _label_of(entry: JsonObject, t_us: int, context: ImportContext) -> Label:
    keypoints, box = entry.get("keypoints"), entry.get("bbox")
    radius = finite(entry["r_px"], "r_px") if "r_px" in entry else None
    own = entry.get("state")
    if isinstance(keypoints, list) and len(keypoints) >= 3 and keypoints[2] != 0:
        x, y = finite(keypoints[0], "x"), finite(keypoints[1], "y")
        state = LabelState.VISIBLE if keypoints[2] == VISIBLE else LabelState.PARTLY_OCCLUDED
        if radius is None and own is None and isinstance(box, list) and len(box) == 4:
            width, height = finite(box[2], "width"), finite(box[3], "height")
            radius = None if width == height == 0 else max(width, height) / 2  # a point says nothing of its size
    elif isinstance(box, list) and len(box) == 4:
        left, top, width, height = (finite(number, "a number of the box") for number in box)
        x, y, radius, state = left + width / 2, top + height / 2, (width + height) / 4, LabelState.VISIBLE
    else:
        raise LabelError("an annotation with neither a keypoint nor a box")
    if isinstance(own, str):
        state = LabelState(own)
    return context.make(t_us, state, x - HALF_PIXEL, y - HALF_PIXEL, radius)
