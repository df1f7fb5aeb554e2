"""COCO keypoints: one JSON file; the ball is a category with its centre as the one keypoint.

Boxes and keypoints count from the picture's corner. Ids start at 1 and areas are above 0: evaluation tools take an id
of 0 for "no match" and score an area of 0 as nothing. A reviewed picture without a ball has no annotation, but is
listed. Contacts are a list of their own, which other readers pass over. For pycocotools set `params.kpt_oks_sigmas` to
one number: its default is for 17 joints of a person.
"""

from __future__ import annotations

import json
import math
from functools import partial
from pathlib import Path

from core.errors import LabelError
from core.files import file_stem
from labels.formats.boxes import Box, box_of, losses_of_box
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
    whole_number,
    write_text,
)
from labels.formats.flat import CONTACT_COLUMNS, contact_of_row, contact_row
from labels.formats.labelled_pictures import DrawnShape, Picture, Place, read_pictures
from labels.model import Label, LabelState

OCCLUDED, VISIBLE = 1, 2
SMALLEST_FILL, LARGEST_FILL = 0.25, 1.25
"""Share of the box that the stated area fills: a circle fills 0.79 of it."""


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
        **({"contacts": [contact_row(contact) for contact in labels.contacts]} if labels.contacts else {}),
        "categories": [{"id": 1, "name": CLASS_NAME, "supercategory": "", "keypoints": ["centre"], "skeleton": []}],
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    return Exported((write_text(folder / f"{file_stem(labels.camera)}.json", text),), count_losses(losses))


def add_contacts(entries: object, file: Path, context: ImportContext, collector: Collector) -> None:
    """Take the contacts of a JSON document, if it has a list of them."""
    for entry in _objects(entries, "contact", file, collector) if isinstance(entries, list) else []:
        with collector.entry(file, entry.line):
            texts = {name: str(entry[name]) for name in CONTACT_COLUMNS if entry.get(name) is not None}
            collector.add_contact(contact_of_row(texts, context.origin), file, entry.line)


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
    return read_pictures(path, ".json", context, _pictures_in)


def _pictures_in(text: str, file: Path, context: ImportContext, collector: Collector) -> list[Picture]:
    """The pictures of one file; ids may be numbers or text: `1`, `1.0` and `"1"` are the same (cvat-ai/cvat#298)."""
    document = parse_json(text)
    lists = [document.get(name) if isinstance(document, dict) else None for name in ("images", "annotations")]
    if not isinstance(document, dict) or not all(isinstance(items, list) for items in lists):
        collector.reject(file, 1, "not a COCO file; expected lists of images and annotations")
        return []
    info = document.get("info")
    if isinstance(info, dict) and not collector.is_of(context, file, info.get("camera"), info.get("recording")):
        return []
    balls = _ball_categories(document, file, context, collector)
    add_contacts(document.get("contacts"), file, context, collector)
    images = _images_by_id(document, file, collector)
    shapes: dict[str, list[DrawnShape]] = {image_id: [] for image_id in images}
    lost = 0
    for entry in _objects(document["annotations"], "annotation", file, collector):
        with collector.entry(file, entry.line):
            lost += 1  # until it is known whose it is
            image_id = _id_of(entry, "image_id")
            lost -= 1
            if image_id not in images:
                raise LabelError("an annotation of an image that is not listed", got=image_id)
            shapes[image_id].append(
                DrawnShape(entry.line, partial(_label_of_ball, entry, images[image_id], balls, context))
            )
    return [
        Picture(
            file=file,
            line=image.line,
            names=(str(image.get("file_name", "")),),
            size=(image.get("width"), image.get("height")),
            whole=partial(_whole, image, bool(shapes[image_id]), lost, context),
            shapes=shapes[image_id],
        )
        for image_id, image in images.items()
    ]


def _ball_categories(document: dict, file: Path, context: ImportContext, collector: Collector) -> frozenset[str]:
    """Ids of the categories that are the ball."""
    categories: dict[str, object] = {}
    for entry in _objects(document.get("categories", []), "category", file, collector):
        with collector.entry(file, entry.line):
            categories[_id_of(entry, "id")] = entry.get("name")
    wanted = context.ball_class
    balls = {number for number, name in categories.items() if isinstance(name, str) and context.is_ball(name)}
    if wanted is not None and wanted.strip().isdecimal() and not balls:
        balls = {str(int(wanted))}
    if not balls and document["annotations"]:
        known = [str(name) for name in categories.values()][:20]
        what = f"no category {wanted or CLASS_NAME!r} among {known}"
        collector.reject(file, 1, LabelError(what, remedy="give --ball-class NAME|N"))
    return frozenset(balls)


def _images_by_id(document: dict, file: Path, collector: Collector) -> dict[str, JsonObject]:
    images: dict[str, JsonObject] = {}
    twice: set[str] = set()
    for image in _objects(document["images"], "image", file, collector):
        with collector.entry(file, image.line):
            image_id = _id_of(image, "id")
            if image_id in images or image_id in twice:  # one name in two folders: cvat-ai/cvat#4185
                twice.add(image_id)
                images.pop(image_id, None)
                raise LabelError("an image id that is used twice: none of the two is taken", got=image_id)
            images[image_id] = image
    return images


def _id_of(entry: JsonObject, key: str) -> str:
    value = entry[key]
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, (int, str)):
        raise LabelError(f"the {key.replace('_', ' ')} is missing or odd", got=repr(value)[:80])
    return str(value).strip()


def _whole(image: JsonObject, annotated: bool, lost: int, context: ImportContext, place: Place) -> Label | None:
    """The label of a picture without annotations; `lost` annotations of its file belong to no picture."""
    if annotated:
        return None
    if lost:
        what = "a picture without annotation, in a file with annotations that belong to no picture"
        raise LabelError(what, got=f"{lost} of them")
    place.check_size()
    t_us, own = _time_of(image, place), image.get("state")
    return context.unannotated(t_us) if own is None else context.make(t_us, LabelState(str(own)))


def _objects(items: object, kind: str, file: Path, collector: Collector) -> list[JsonObject]:
    found = []
    for number, item in enumerate(items if isinstance(items, list) else [items]):
        if isinstance(item, JsonObject):
            found.append(item)
        else:
            collector.reject(file, 1, f"{kind} {number} is not an object")
    return found


def _time_of(image: JsonObject, place: Place) -> int:
    t_us = image.get("t_us")
    if isinstance(t_us, int) and not isinstance(t_us, bool):
        place.check_camera()
        return t_us
    if "file_name" not in image:
        raise LabelError("missing 'file_name'")
    return place.t_us


def _label_of_ball(
    entry: JsonObject, image: JsonObject, balls: frozenset[str], context: ImportContext, place: Place
) -> Label:
    category = _id_of(entry, "category_id")
    if category not in balls:
        raise LabelError(f"category {category} is not {context.ball_class or CLASS_NAME!r}")
    factors = place.factors
    return _label_of(entry, _time_of(image, place), factors, context)


def _label_of(entry: JsonObject, t_us: int, factors: tuple[float, float], context: ImportContext) -> Label:
    if entry.get("iscrowd") not in (None, 0, False) or entry.get("ignore") not in (None, 0, False):
        raise LabelError("a crowd, or an annotation to be ignored, is not one ball")
    across, down = factors
    box = _box_of(entry)
    radius = finite(entry["r_px"], "r_px") * (across + down) / 2 if "r_px" in entry else None
    own = entry.get("state")
    point = _keypoint_of(entry)
    if point is not None:
        x, y, state = point
        if own is None and box is not None and box[2] > 0 and box[3] > 0:
            left, top, width, height = box
            if abs(x - left - width / 2) > 2 * width or abs(y - top - height / 2) > 2 * height:
                raise LabelError("the keypoint lies far from its box", got=f"({x:g}, {y:g}) and {box}")
            radius = max(width * across, height * down) / 2 if radius is None else radius
    elif box is not None:
        left, top, width, height = box
        if width <= 0 or height <= 0:
            raise LabelError("the box is empty", got=box)
        _compare_area(entry, width * height)
        # Mean of half the width and half the height: a box of a ball is square but for clicks.
        x, y, radius = left + width / 2, top + height / 2, (width * across + height * down) / 4
        attributes = entry.get("attributes")
        hidden = isinstance(attributes, dict) and attributes.get("occluded") in (True, 1, "true", "True", "1")
        state = LabelState.PARTLY_OCCLUDED if hidden else LabelState.VISIBLE
    else:
        raise LabelError("an annotation with neither a keypoint nor a box")
    if isinstance(own, str):
        state = LabelState(own)
    # COCO counts from the picture's corner, we from the middle of the first pixel.
    return context.ball(t_us, state, x * across - HALF_PIXEL, y * down - HALF_PIXEL, radius)


def _box_of(entry: JsonObject) -> tuple[float, float, float, float] | None:
    box = entry.get("bbox")
    if not isinstance(box, list) or len(box) != 4:
        return None
    left, top, width, height = (finite(number, "a number of the box") for number in box)
    return left, top, width, height


def _keypoint_of(entry: JsonObject) -> tuple[float, float, LabelState] | None:
    """The only keypoint, if it is labelled; of several it is not known which one is the ball's centre."""
    keypoints = entry.get("keypoints")
    if not isinstance(keypoints, list) or len(keypoints) != 3:
        return None
    visibility = whole_number(keypoints[2], "the visibility of the keypoint")
    if visibility == 0:
        return None
    if visibility not in (OCCLUDED, VISIBLE):
        raise LabelError("unknown visibility of the keypoint", expected="0, 1 or 2", got=visibility)
    state = LabelState.VISIBLE if visibility == VISIBLE else LabelState.PARTLY_OCCLUDED
    return finite(keypoints[0], "x"), finite(keypoints[1], "y"), state


def _compare_area(entry: JsonObject, area: float) -> None:
    """Compare a stated area with the box: where corners stand instead of sides, it is much smaller.

    Corners are what weecology/DeepForest#1215 was about.

    Raises:
        LabelError: if it is no area of a ball in this box.
    """
    stated = entry.get("area")
    if not isinstance(stated, (int, float)) or isinstance(stated, bool) or not stated > 0:
        return
    if not SMALLEST_FILL * area <= stated <= LARGEST_FILL * area:
        remedy = "bbox is x, y, width, height: are these two corners?"
        raise LabelError("the box and its area contradict each other", expected=f"{area:g}", got=stated, remedy=remedy)
