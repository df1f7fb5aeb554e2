"""TrackNet CSV: a row for every picture of a clip, numbered from 0, whole pixels of the original size.

Three dialects are read by their headers: TrackNetV2 and V3 (`Frame,Visibility,X,Y`), the labelling tool imgLabel
(`Frame,Ball,x,y`, shares of the picture) and the tennis set of TrackNet v1 (`file name,visibility,...`). The first is
written. The format has no way to say that nobody looked at a picture, so such clips are refused unless told to drop
these pictures. `frames.csv` beside it holds the time of each number.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.errors import LabelError
from core.files import file_stem
from core.foreign_tables import NO_NUMBER
from labels.formats.exchange import (
    HALF_PIXEL,
    Collector,
    Exported,
    ExportOptions,
    ImportContext,
    Imported,
    LabelSet,
    add_rows,
    count_losses,
    files_at,
    finite,
    read_text,
    table_rows,
    whole_number,
    write_text,
)
from labels.formats.labelled_pictures import SamePictures, note_likely_size
from labels.formats.picture_files import PictureFiles
from labels.formats.picture_times import PictureTimes, check_numbers
from labels.model import Label, LabelState

HEADER = ["Frame", "Visibility", "X", "Y"]
IMGLABEL_HEADER = ["Frame", "Ball", "x", "y"]
TENNIS_START = ["file name", "visibility", "x-coordinate", "y-coordinate"]
FRAMES = "frames.csv"
FRAMES_HEADER = ["frame", "t_us"]


def write_tracknet(labels: LabelSet, folder: Path, options: ExportOptions) -> Exported:
    """`<camera>_ball.csv` and `frames.csv`.

    Raises:
        LabelError: if pictures are unchecked and `drop_unchecked` is off.
    """
    if labels.unchecked_us and not options.drop_unchecked:
        raise LabelError(
            f"{len(labels.unchecked_us)} pictures of this clip are unchecked, and TrackNet would call them empty",
            got=f"the first one at {labels.unchecked_us[0]} us",
            remedy="label them, or leave them out with --unchecked drop",
        )
    losses = ["provenance, covariance and radius"] * bool(labels.labels)
    rows = []
    for number, label in enumerate(labels.labels):
        found = label.state.seen and label.x_px is not None and label.y_px is not None
        losses += [f"state {label.state}"] if label.state not in (LabelState.VISIBLE, LabelState.NO_BALL) else []
        x, y = (label.x_px, label.y_px) if found else (0.0, 0.0)
        assert x is not None and y is not None
        if found and options.whole_pixels:
            losses.append("position rounded to whole pixels")
            # Halves always up; Python's round goes to the even number, a bias that depends on the pixel.
            x, y = float(np.floor(x + 0.5)), float(np.floor(y + 0.5))
        if found and (x, y) == (0.0, 0.0):
            losses.append("a ball at (0, 0), which TrackNet's evaluation takes for none")
        text = [f"{value:.0f}" if options.whole_pixels or not found else f"{value:.3f}" for value in (x, y)]
        rows.append(f"{number},{int(found)},{text[0]},{text[1]}")
    file = folder / f"{file_stem(labels.camera)}_ball.csv"
    if others := sorted(other.name for other in folder.glob("*_ball.csv") if other != file):  # frames.csv is theirs
        remedy = "give each camera a folder of its own"
        raise LabelError(f"{FRAMES} holds the times of one camera", got=others[0], where=folder, remedy=remedy)
    main = write_text(file, "\n".join([",".join(HEADER), *rows, ""]))
    frames = write_frame_times(folder, [label.t_us for label in labels.labels])
    return Exported((main, frames), count_losses(losses))


def write_frame_times(folder: Path, t_us: Sequence[int]) -> Path:
    """`frames.csv`, which holds the time of each picture by its number from 0."""
    rows = [f"{number},{time_us}" for number, time_us in enumerate(t_us)]
    return write_text(folder / FRAMES, "\n".join([",".join(FRAMES_HEADER), *rows, ""]))


def read_tracknet(path: Path, context: ImportContext) -> Imported:
    """Every CSV file of a folder, or one; times come from `frames.csv` beside it, else from the context."""
    collector = Collector()
    tables: list[_Table] = []
    same = SamePictures()
    for file in files_at(path, ".csv", collector):
        text = None if file.name == FRAMES else read_text(file, collector)
        table = None if text is None else _table_of(text, file, collector)
        if table is not None:
            tables.append(table)
            same.add(file, table.pictures)
    times: dict[Path, dict[int, int] | None] = {}
    pictures = PictureFiles()
    for table in tables:
        folder = table.file.parent
        if folder not in times:
            times[folder] = read_frame_times(folder / FRAMES, collector) if (folder / FRAMES).is_file() else None
        if same.accept(table.file, collector) and _size_fits(table, pictures, context, collector):
            _read_table(table, times[folder], context, collector)
            unsized = pictures.size_of_clip(table.file) is None and times[folder] is None  # frames.csv: our own export
            if unsized and not table.columns.shares:
                note_likely_size(table.places, context, collector)
    return collector.done()


@dataclass(frozen=True, slots=True)
class _Columns:
    """Where a table has what, and how it counts."""

    picture: int
    visibility: int
    x: int
    y: int
    shares: bool
    """Whether positions are shares of the picture instead of pixels."""
    named: bool
    """Pictures by their names, instead of numbers."""


def _columns_of(header: list[str]) -> _Columns | None:
    """None if these are not the columns of a TrackNet table; further columns may be anything."""
    small = [name.lower() for name in header]
    for names, shares, named in ((HEADER, False, False), (IMGLABEL_HEADER, True, False), (TENNIS_START, False, True)):
        if all(small.count(name.lower()) == 1 for name in names):
            return _Columns(*(small.index(name.lower()) for name in names), shares=shares, named=named)
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """One file whose columns are known."""

    file: Path
    header: list[str]
    columns: _Columns
    rows: list[tuple[int, list[str]]]
    """With their lines, without the header."""

    @property
    def pictures(self) -> list[str]:
        """What pictures are called or numbered, without the rows that are too short."""
        return [fields[self.columns.picture].strip() for _, fields in self.rows if len(fields) == len(self.header)]

    @property
    def places(self) -> list[tuple[float, float]]:
        """The pixels (x, y) of the rows that say that there is a ball."""
        found: list[tuple[float, float]] = []
        for _, fields in self.rows:
            with suppress(ValueError, IndexError):
                if float(fields[self.columns.visibility]) != 0:
                    found.append((float(fields[self.columns.x]), float(fields[self.columns.y])))
        return found


def _table_of(text: str, file: Path, collector: Collector) -> _Table | None:
    rows = list(table_rows(text, file, collector))
    header = [name.strip() for name in rows[0][1]] if rows else []
    columns = _columns_of(header)
    if columns is None:
        expected = f"{','.join(HEADER)} or {','.join(IMGLABEL_HEADER)} or {','.join(TENNIS_START)}, and others"
        collector.reject(file, 1, f"not a TrackNet file; expected the columns {expected}")
        return None
    table = _Table(file, header, columns, rows[1:])
    if not columns.shares and _looks_like_shares(table.places):
        what = "all positions are below 1: shares of the picture where pixels belong"
        remedy = f"name the columns {','.join(IMGLABEL_HEADER)} if they are shares"
        collector.reject(file, 1, LabelError(what, remedy=remedy))
        return None
    return table


def _size_fits(table: _Table, pictures: PictureFiles, context: ImportContext, collector: Collector) -> bool:
    """Whether the clip's pictures, where they are found, have the size that the table's pixels are taken to be of.

    Pixels of pictures of 640x360 were taken for the sensor's: yastrebksv/TrackNet#8, alenzenx/TrackNetV3#16.
    """
    if table.columns.shares or context.picture_size is not None:
        return True
    size, sensor = pictures.size_of_clip(table.file), context.sensor
    if size is None or size == (sensor.width_px, sensor.height_px):
        return True
    expected, got = str(sensor), f"{size[0]}x{size[1]}"
    what, remedy = "the clip's pictures have another size", f"--picture-size {got} if the table counts their pixels"
    collector.reject(table.file, 1, LabelError(what, expected=expected, got=got, remedy=remedy))
    return False


def _read_table(table: _Table, times: dict[int, int] | None, context: ImportContext, collector: Collector) -> None:
    columns = table.columns
    pictures = PictureTimes.of(table.pictures if columns.named else (), context)
    numbers = [] if columns.named else sorted(_numbers_in(table.pictures))

    def label_of(fields: list[str]) -> Label:
        picture = fields[columns.picture].strip()
        if times is None and not columns.shares and _is_corner(fields, columns):
            raise LabelError("a ball in the very corner of the picture: 0, 0 stands for no position")
        if columns.named:
            t_us = pictures.time_of(picture)
        else:
            if times is None and context.frame_times_us is not None:
                check_numbers(numbers, context.frame_times_us)
            t_us = _time_of(picture, times, context)
        return _label_of(fields, columns, t_us, context)

    add_rows(table.rows, len(table.header), table.file, collector, label_of)


def _is_corner(fields: list[str], columns: _Columns) -> bool:
    """Whether a ball that is said to be visible has the position 0, 0, which other tools write where there is none.

    TTNet does so: maudzung/TTNet-Real-time-Analysis-System-for-Table-Tennis-Pytorch#34.
    """
    numbers = [fields[place].strip() for place in (columns.visibility, columns.x, columns.y)]
    return numbers[0] in ("1", "1.0", "2", "2.0") and all(number in ("0", "0.0") for number in numbers[1:])


def _numbers_in(pictures: list[str]) -> set[int]:
    found = set()
    for picture in pictures:
        with suppress(LabelError):
            found.add(whole_number(picture, "the frame"))
    return found


def _looks_like_shares(places: list[tuple[float, float]]) -> bool:
    """Whether there are balls with a broken position, and none of them is farther than a pixel from the corner.

    Such were in Chang-Chia-Chi/TrackNet-Badminton-Tracking-tensorflow2#8.
    """
    numbers = [number for place in places for number in place]
    return len(numbers) > 0 and all(0 <= value <= 1 for value in numbers) and any(value % 1 for value in numbers)


def _time_of(text: str, times: dict[int, int] | None, context: ImportContext) -> int:
    number = whole_number(text, "the frame")
    if times is None:
        return context.time_of_frame(number)
    if number not in times:
        raise LabelError(f"frame {number} is not in {FRAMES}")
    return times[number]


def _label_of(fields: list[str], columns: _Columns, t_us: int, context: ImportContext) -> Label:
    visibility = whole_number(fields[columns.visibility].strip(), "the visibility")
    places = fields[columns.x].strip(), fields[columns.y].strip()
    if visibility == 0:
        if any(place.lower() not in NO_NUMBER and finite(place, "a coordinate") > 0 for place in places):
            raise LabelError("a position where the visibility says that there is no ball", got=",".join(places))
        return context.make(t_us, LabelState.NO_BALL)
    if visibility not in (1, 2, 3):
        raise LabelError("unknown visibility", expected="0 to 3", got=visibility)
    if visibility == 3 and set(map(str.lower, places)) <= NO_NUMBER:
        return context.make(t_us, LabelState.OCCLUDED)
    x, y = finite(places[0], "x"), finite(places[1], "y")
    if columns.shares:
        if not (0 <= x <= 1 and 0 <= y <= 1):
            raise LabelError("outside the picture", expected="shares of it, 0 to 1", got=(x, y))
        # Qt counts from the corner of the picture.
        x, y = x * context.sensor.width_px - 0.5, y * context.sensor.height_px - 0.5
    else:
        across, down = context.stated_factors
        x, y = (x + HALF_PIXEL) * across - HALF_PIXEL, (y + HALF_PIXEL) * down - HALF_PIXEL
    hidden = {1: LabelState.VISIBLE, 2: LabelState.PARTLY_OCCLUDED, 3: LabelState.OCCLUDED}
    return context.ball(t_us, hidden[visibility], x, y, None)


def read_frame_times(file: Path, collector: Collector) -> dict[int, int]:
    """Time of each picture by its number, us; rows that say none are rejected."""
    text = read_text(file, collector)
    rows = list(table_rows(text or "", file, collector))
    if not rows or [name.strip() for name in rows[0][1]] != FRAMES_HEADER:
        collector.reject(file, 1, f"expected {','.join(FRAMES_HEADER)}")
        return {}
    times: dict[int, int] = {}
    for line, fields in rows[1:]:
        with collector.entry(file, line):
            number, t_us = (whole_number(field, "a number") for field in fields)
            if number in times:
                raise LabelError(f"frame {number} twice")
            times[number] = t_us
    return times
