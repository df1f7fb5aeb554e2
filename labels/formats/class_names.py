"""Which class is the ball: from the list of names where each tool puts it, or as the user says; never by assumption."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import yaml

from core.errors import LabelError
from labels.formats.exchange import CLASS_NAME, Collector, ImportContext, read_text
from labels.formats.json_lines import parse_json

LISTS: Final = ("classes.txt", "obj.names", "predefined_classes.txt", "_darknet.labels", "labels.txt")
"""A name a line: LabelImg and Label Studio, CVAT and darknet, Roboflow."""
YAMLS: Final = ("data.yaml", "data.yml", "dataset.yaml", "dataset.yml")
NOTES: Final = "notes.json"
"""Of Label Studio: categories with ids."""
LEVELS: Final = 3
"""Folders above that of the texts in which a data set may have its list."""
MAX_CLASSES: Final = 10_000


def find_ball_number(folder: Path, context: ImportContext, collector: Collector) -> int | None:
    """The number that means a ball in the texts of a folder; None after a rejection that says what to do."""
    wanted = context.ball_class
    if wanted is not None and wanted.strip().isdecimal():
        return int(wanted)
    found = {file: names for file, names in _lists(folder, collector) if names}
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
    if len(set(numbers.values())) > 1:
        numbered = ", ".join(f"{number} in {file.name}" for file, number in numbers.items())
        error = LabelError("lists of class names disagree", got=numbered, remedy="give --ball-class N")
        collector.reject(folder, 1, error)
        return None
    file, number = next(iter(numbers.items()))
    collector.note(f"class {number} is the ball, as {file} says")
    return number


def _lists(folder: Path, collector: Collector) -> Iterator[tuple[Path, dict[int, str]]]:
    """The lists of the nearest folder that has any: the texts' own, or one above."""
    for place in (folder, *folder.absolute().parents[:LEVELS]):
        files = [place / name for name in (*LISTS, *YAMLS, NOTES) if (place / name).is_file()]
        yield from ((file, _names_in(file, collector)) for file in files)
        if files:
            return


def _names_in(file: Path, collector: Collector) -> dict[int, str]:
    text = read_text(file, collector) or ""
    if file.name in LISTS:
        lines = [line.strip() for line in text.splitlines()]
        while lines and not lines[-1]:
            lines.pop()
        return dict(enumerate(lines[:MAX_CLASSES]))
    try:
        content = parse_json(text) if file.name == NOTES else yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError, LookupError, AttributeError, TypeError, LabelError) as error:
        collector.reject(file, 1, f"not {'JSON' if file.name == NOTES else 'YAML'}: {error}")
        return {}
    if not isinstance(content, dict):
        return {}
    if file.name == NOTES:
        items = _dicts(content.get("categories"))
        return _named({item.get("id"): item.get("name") for item in items if _hashable(item.get("id"))})
    names = content.get("names")
    return _named(names if isinstance(names, dict) else dict(enumerate(names)) if isinstance(names, list) else {})


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
