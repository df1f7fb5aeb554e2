"""Which class is the ball: from the list of names where each tool puts it, or as the user says; never by assumption."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import yaml

from core.errors import LabelError
from core.yaml_loader import UntaggedLoader
from labels.formats.documents import parse_json
from labels.formats.exchange import CLASS_NAME, Collector, ImportContext, read_text

LISTS: Final = ("classes.txt", "obj.names", "predefined_classes.txt", "_darknet.labels", "labels.txt", "names.txt")
"""A name a line: LabelImg and Label Studio, CVAT and darknet, Roboflow."""
YAMLS: Final = ("data.yaml", "data.yml", "dataset.yaml", "dataset.yml")
ENDS: Final = (".yaml", ".yml", ".names")
NOTES: Final = "notes.json"
"""File of Label Studio: categories with ids."""
LEVELS: Final = 3
"""Folders above that of the texts in which a data set may have its list."""
MAX_CLASSES: Final = 10_000
MAX_YAMLS: Final = 20
"""Most YAML files of other names that are looked into in one folder."""


@dataclass(frozen=True, slots=True)
class BallClass:
    """What the texts of a folder mean."""

    number: int
    """The class that is the ball."""
    classes: int | None = None
    """How many classes the list has; None: there is none, the user named the number."""
    keypoint_numbers: int | None = None
    """Numbers of the one keypoint of a pose: 2 or 3, 0 without one; None: not said."""


def find_ball_class(folder: Path, context: ImportContext, collector: Collector) -> BallClass | None:
    """What means a ball in the texts of a folder; None after a rejection that says what to do."""
    wanted = context.ball_class
    files = {file: _content_of(file, collector) for file in _lists(folder)}
    try:
        shapes = {shape for content in files.values() if (shape := _keypoint_numbers(content)) is not None}
    except LabelError as error:
        collector.reject(folder, 1, error)
        return None
    keypoint = shapes.pop() if len(shapes) == 1 else None
    if wanted is not None and wanted.strip().isdecimal():
        return BallClass(int(wanted), None, keypoint)
    found = {file: content.names for file, content in files.items() if content.names}
    for file, content in files.items():
        if content.names and content.count is not None and content.count != 1 + max(content.names):
            error = LabelError("nc and names contradict", expected=f"{content.count} names", got=len(content.names))
            collector.reject(file, 1, error)
            return None
    if not found:
        what = f"no list of class names ({', '.join((LISTS[0], YAMLS[0], LISTS[1], NOTES))}) here or above"
        collector.reject(folder, 1, LabelError(what, remedy="give --ball-class N: numbers mean nothing without it"))
        return None
    numbers: dict[Path, int] = {}
    for file, names in found.items():
        matching = [number for number, name in names.items() if context.is_ball(name)]
        if len(matching) > 1:
            collector.reject(file, 1, LabelError("several classes are the ball", got=matching, remedy="--ball-class N"))
            return None
        if matching:
            numbers[file] = matching[0]
    if not numbers:
        file, names = next(iter(found.items()))
        known = [name for name in names.values() if name][:20]
        what = f"no class {wanted or CLASS_NAME!r} among {known}"
        collector.reject(file, 1, LabelError(what, remedy="give --ball-class NAME|N"))
        return None
    for file in _lists_above(folder, next(iter(numbers)).parent):  # HumanSignal/labelImg#721
        above = [number for number, name in _content_of(file, Collector()).names.items() if context.is_ball(name)]
        if len(above) == 1:
            numbers[file] = above[0]
    if len(set(numbers.values())) > 1:  # classes.txt and notes.json of one export: HumanSignal/label-studio#6416
        numbered = ", ".join(f"{number} in {file.parent.name}/{file.name}" for file, number in numbers.items())
        error = LabelError("lists of class names disagree", got=numbered, remedy="give --ball-class N")
        collector.reject(folder, 1, error)
        return None
    file, number = next(iter(numbers.items()))
    collector.note(f"class {number} is the ball, as {file} says")
    return BallClass(number, 1 + max(max(names) for names in found.values()), keypoint)


def _lists(folder: Path) -> list[Path]:
    """The lists of the nearest folder that has any: the texts' own, or one above."""
    return next((files for place in _places(folder) if (files := _lists_in(place))), [])


def _lists_above(folder: Path, nearest: Path) -> list[Path]:
    """The lists of the folders above the nearest one that has any."""
    places = _places(folder)
    at = next((number for number, place in enumerate(places) if place.samefile(nearest)), len(places))
    return [file for place in places[at + 1 :] for file in _lists_in(place)]


def _places(folder: Path) -> list[Path]:
    return [folder, *folder.absolute().parents[:LEVELS]]


def _lists_in(place: Path) -> list[Path]:
    there = {file.name.lower(): file for file in _files_in(place)}
    files = [there[name] for name in (*LISTS, *YAMLS, NOTES) if name in there]
    if files:
        return files
    # Ultralytics takes a YAML file of any name, darknet a list
    others = sorted(file for file in there.values() if file.suffix.lower() in ENDS)
    return [file for file in others[:MAX_YAMLS] if not file.name.startswith(".") and _has_names(file)]


def _files_in(place: Path) -> list[Path]:
    try:
        return [file for file in place.iterdir() if file.is_file()]
    except OSError:  # a folder above that others may not list
        return []


def _has_names(file: Path) -> bool:
    return bool(_content_of(file, Collector()).names)


@dataclass(frozen=True, slots=True)
class _Content:
    """What a list says."""

    names: dict[int, str]
    count: int | None = None
    """`nc` of YAML files."""
    keypoints: object = None
    """`kpt_shape` of YAML files."""


def _keypoint_numbers(content: _Content) -> int | None:
    """Numbers of the keypoint; None if nothing is said.

    Raises:
        LabelError: if there are several keypoints.
    """
    if content.keypoints is None:
        return None
    shape = content.keypoints
    if not (isinstance(shape, list) and len(shape) == 2 and shape[0] == 1 and shape[1] in (2, 3)):
        expected = "[1, 2] or [1, 3]: the ball's centre"
        raise LabelError("a pose of other keypoints", expected=expected, got=f"kpt_shape {shape!r}"[:80])
    return int(shape[1])


def _content_of(file: Path, collector: Collector) -> _Content:
    text = read_text(file, collector) or ""
    if file.name.lower() in LISTS or file.suffix.lower() == ".names":
        lines = [line.strip() for line in text.splitlines()]
        while lines and not lines[-1]:
            lines.pop()
        return _Content(dict(enumerate(lines[:MAX_CLASSES])))
    try:
        content = parse_json(text) if file.name.lower() == NOTES else yaml.load(text, Loader=UntaggedLoader)
    except (yaml.YAMLError, ValueError, RecursionError, LookupError, AttributeError, TypeError, LabelError) as error:
        collector.reject(file, 1, f"not {'JSON' if file.name.lower() == NOTES else 'YAML'}: {error}")
        return _Content({})
    if not isinstance(content, dict):
        return _Content({})
    if file.name.lower() == NOTES:
        items = _dicts(content.get("categories"))
        return _Content(_named({item.get("id"): item.get("name") for item in items if _hashable(item.get("id"))}))
    names, count = content.get("names"), content.get("nc")
    named = _named(names if isinstance(names, dict) else dict(enumerate(names)) if isinstance(names, list) else {})
    return _Content(named, count if type(count) is int else None, content.get("kpt_shape"))


def _dicts(items: object) -> list[dict]:
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def _hashable(value: object) -> bool:
    return isinstance(value, (int, str))


def _named(names: dict) -> dict[int, str]:
    """Numbers and plain names. A list is none: by anchors a few lines of YAML make lists of billions."""
    numbered: dict[int, str] = {}
    for key, value in list(names.items())[:MAX_CLASSES]:
        number = int(key) if isinstance(key, str) and key.strip().isdecimal() and len(key) < 10 else key
        if isinstance(number, int) and not isinstance(number, bool) and number >= 0:
            numbered[number] = str(value) if isinstance(value, (str, int, float)) else ""
    return numbered
