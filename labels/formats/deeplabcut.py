"""DeepLabCut's CSV: labels by hand (`CollectedData_NAME.csv`) and the positions that a network found in a video.

The first lines name the scorer, perhaps the individual, the body part and the coordinate of each column; a row begins
with the name of its picture, in one column or by its folders in three, or with the number of its picture. One body part
is the ball. Pixel centres are whole numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from core.errors import LabelError
from core.foreign_tables import NO_NUMBER
from labels.formats.exchange import CLASS_NAME, HALF_PIXEL, Collector, ImportContext, add_rows, finite, whole_number
from labels.formats.labelled_pictures import note_likely_size
from labels.formats.picture_times import PictureTimes
from labels.model import Label, LabelState

_LEVELS: Final = ("scorer", "individuals", "bodyparts", "coords")
LEAST_LIKELIHOOD: Final = 0.6
"""DeepLabCut's own `pcutoff`: what is less likely it does not draw."""
Rows = list[tuple[int, list[str]]]


def is_deeplabcut(header: list[str]) -> bool:
    """Whether the first line of a table is DeepLabCut's."""
    return header[:1] == ["scorer"] and len(header) > 2


def read_deeplabcut(
    header: list[str], rows: Iterator[tuple[int, list[str]]], file: Path, context: ImportContext, collector: Collector
) -> None:
    """Add a label for each row with a position of the ball; a row without one says nothing."""
    levels, body = {"scorer": header}, list(rows)
    while body and body[0][1][0].strip() in _LEVELS:
        fields = [field.strip() for field in body.pop(0)[1]]
        levels[fields[0]] = fields
    try:
        x, y, likelihood, names = _columns(levels, len(header), context)
    except LabelError as error:
        collector.reject(file, 1, error)
        return
    pictures = [_name_of(fields, names) for _, fields in body]
    numbered = names == 1 and all(name.isdecimal() for name in pictures)
    times = None if numbered else PictureTimes.of(pictures, context)
    across, down = context.stated_factors
    unlikely = 0
    seen: list[tuple[float, float]] = []

    def label_of(fields: list[str]) -> Label | None:
        nonlocal unlikely
        if {fields[x].strip().lower(), fields[y].strip().lower()} & NO_NUMBER:
            return None
        if likelihood is not None and finite(fields[likelihood], "the likelihood") < LEAST_LIKELIHOOD:
            unlikely += 1
            return None
        # DeepLabCut counts from the first pixel's middle, but a picture is scaled about its corner.
        place = [(finite(fields[column], "a coordinate") + HALF_PIXEL) for column in (x, y)]
        seen.append((place[0], place[1]))
        name = _name_of(fields, names)
        t_us = context.time_of_frame(whole_number(name, "the frame")) if times is None else times.time_of(name)
        return context.ball(
            t_us, LabelState.VISIBLE, place[0] * across - HALF_PIXEL, place[1] * down - HALF_PIXEL, None
        )

    add_rows(body, len(header), file, collector, label_of)
    note_likely_size(seen, context, collector)
    if unlikely:
        collector.note(f"{file.name}: {unlikely:,} positions of a likelihood below {LEAST_LIKELIHOOD} were left out")


def _name_of(fields: list[str], columns: int) -> str:
    """The name of a row's picture, which stands in one column or by its folders in several."""
    return "/".join(field.strip() for field in fields[:columns])


def _columns(levels: dict[str, list[str]], count: int, context: ImportContext) -> tuple[int, int, int | None, int]:
    """The columns of x, y and the likelihood of the ball, and how many columns the name of a picture has.

    Raises:
        LabelError: if the ball cannot be told.
    """
    parts, coordinates = levels.get("bodyparts", []), levels.get("coords", [])
    if not len(parts) == len(coordinates) == count:
        raise LabelError(
            "not DeepLabCut's table", expected="scorer, bodyparts and coords, a line each", got=list(levels)
        )
    names = next((column for column, name in enumerate(coordinates) if name in ("x", "y", "likelihood")), count)
    who = levels.get("individuals", [""] * count)
    balls = {(who[column], parts[column]) for column in range(names, count) if context.is_ball(parts[column])}
    if len(balls) != 1:
        what = f"{len(balls) or 'no'} body parts are called {context.ball_class or CLASS_NAME!r}"
        got = ", ".join(dict.fromkeys(parts[names:]))[:200]
        raise LabelError(what, expected="one", got=got, remedy="which is the ball? --ball-class NAME")
    (ball,) = balls
    own = {coordinates[column]: column for column in range(names, count) if (who[column], parts[column]) == ball}
    if not {"x", "y"} <= own.keys():
        raise LabelError("the ball has no x and y", got=list(own))
    return own["x"], own["y"], own.get("likelihood"), names
