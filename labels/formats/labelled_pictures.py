"""One loop for formats of pictures with shapes: a format parses its files into neutral pictures, and writes them.

What a picture's name, number and size mean is told from all pictures of an import together, so all files are parsed
before the first label is made.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import LabelError
from core.events import SensorSize
from labels.formats.exchange import Collector, ImportContext, Imported, files_at, finite, read_text
from labels.formats.picture_times import PictureTimes
from labels.model import Label

SAME_SHAPE: Final = 0.02
"""Pictures whose ratio of sides differs by no more are of one shape."""
_USUAL_SIZES: Final = ((320, 180), (320, 240), (416, 416), (512, 288), (640, 360), (640, 480))
"""Width and height of pictures that trackers are given: TrackNet's is 512x288, its first version's 640x360."""
_FAR_SMALLER: Final = 0.4
"""Share of the sensor's area that such pictures have at most."""
_LEAST_POSITIONS: Final = 10
"""So many positions or more tell the size of their pictures."""
StatedSize = tuple[object, object]
"""Width and height as a file states them: of any types, perhaps missing."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnShape:
    """Something that was drawn in a picture."""

    line: int
    label: Callable[[Place], Label]
    """The ball that it is; raises LabelError if it is none."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Picture:
    """One picture of a file of labels, as its format has parsed it."""

    file: Path
    line: int
    names: tuple[str, ...]
    """What it is called, and what else tells which it is; empty for one whose place nobody asks for."""
    size: StatedSize = (None, None)
    sizes: Sequence[StatedSize] = ()
    """Where each shape states the size of its picture instead."""
    index: Callable[[], int | None] = lambda: None
    """The tool's own number of it; raises LabelError if it is none."""
    whole: Callable[[Place], Label | None] = lambda place: None
    """The label of the picture as a whole, such as that there is no ball; None: its shapes are the labels. Raises
    LabelError if nothing of it can be taken.
    """
    shapes: Sequence[DrawnShape] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a picture lies among the others: its time and its scale, found when they are asked for."""

    picture: Picture
    times: Sequence[PictureTimes]
    """For each of its names."""
    scaling: PictureScaling

    @property
    def t_us(self) -> int:
        """The time that the names tell.

        Raises:
            LabelError: if none tells, or they tell different times.
        """
        found: list[int] = []
        errors: list[LabelError] = []
        for times, name in zip(self.times, self.picture.names, strict=False):
            try:
                found.append(times.time_of(name, self.picture.index()))
            except LabelError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        if len(set(found)) > 1:
            got = f"{self.picture.names[0]!r} and {self.picture.names[1]!r}"
            raise LabelError("<filename> and the file's name are of two pictures", got=got, remedy="rename the file")
        return found[0]

    def check_camera(self) -> None:
        """Raises LabelError if its name is that of a picture of another camera."""
        for times, name in zip(self.times, self.picture.names, strict=False):
            times.check_camera(name)

    @property
    def factors(self) -> tuple[float, float]:
        """From the picture's pixels to the sensor's, along x and y.

        Raises:
            LabelError: if it has another size than the sensor and is not scaled.
        """
        return self.scaling.of(stated_size(*self.picture.size))

    def check_size(self) -> None:
        """Raises LabelError if the picture has another size than the sensor and is not scaled."""
        self.scaling.of(stated_size(*self.picture.size))


@dataclass(frozen=True, slots=True)
class PictureScaling:
    """From the pictures that were labelled to the sensor."""

    sensor: SensorSize
    scaled_from: tuple[float, float] | None
    """The size that all pictures have, if they are scaled."""

    def of(self, size: tuple[float, float] | None) -> tuple[float, float]:
        """The factors (x, y) of a picture of this size.

        Raises:
            LabelError: if it has another size than the sensor and is not scaled.
        """
        if size is None and self.scaled_from is not None:
            raise LabelError("a picture without a size, among others that are scaled")
        if size is None or size == (self.sensor.width_px, self.sensor.height_px):
            return 1.0, 1.0
        if size != self.scaled_from:
            raise LabelError(
                "the picture has another size than the sensor",
                expected=str(self.sensor),
                got=f"{size[0]:g}x{size[1]:g}",
                remedy="is it this camera's? --scale-pictures scales labels if all pictures have one size",
            )
        return self.sensor.width_px / size[0], self.sensor.height_px / size[1]


def stated_size(width: object, height: object) -> tuple[float, float] | None:
    """A picture's size as a file states it; None where it states none, or 0 as LabelImg does of unknown pictures.

    Raises:
        LabelError: if it is no size.
    """
    if width in (None, "") or height in (None, ""):
        return None
    size = finite(width, "a picture's width"), finite(height, "a picture's height")
    if size == (0.0, 0.0):
        return None
    if not min(size) > 0:
        raise LabelError("an impossible picture size", got=f"{size[0]:g}x{size[1]:g}")
    return size


def scaling_of(sizes: Iterable[StatedSize], context: ImportContext, collector: Collector) -> PictureScaling:
    """How pictures of the stated sizes become the sensor's; an impossible size is reported with its picture."""
    stated: set[tuple[float, float]] = set()
    for pair in sizes:
        with suppress(LabelError):
            if (size := stated_size(*pair)) is not None:
                stated.add(size)
    width, height = context.sensor.width_px, context.sensor.height_px
    other = [size for size in stated if size != (width, height)]
    if not other or len(stated) > 1 or not context.scale_pictures or (height, width) in other:
        return PictureScaling(context.sensor, None)
    ((across, down),) = stated
    collector.note(f"all pictures are {across:g}x{down:g}: scaled to the sensor's {context.sensor}")
    if abs(across * height / (down * width) - 1) > SAME_SHAPE:
        collector.note("their shape is another than the sensor's: they are taken for stretched, not for padded")
    return PictureScaling(context.sensor, (across, down))


def note_likely_size(places: Sequence[tuple[float, float]], context: ImportContext, collector: Collector) -> None:
    """Note if positions whose files state no size may be of far smaller pictures than the sensor's.

    Args:
        places: pixels (x, y) as a file counts them.
        context: tells the sensor, and the size if a person states it.
        collector: gets the note.
    """
    if context.picture_size is not None or len(places) < _LEAST_POSITIONS:
        return
    right, bottom = (max(side) for side in zip(*places, strict=True))
    area = _FAR_SMALLER * context.sensor.width_px * context.sensor.height_px
    for width, height in _USUAL_SIZES:
        # A ball that keeps to a corner of large pictures does not come near both far edges of small ones.
        if width / 2 < right < width and height / 2 < bottom < height and width * height <= area:
            place, size = f"all {len(places)} positions lie within {width}x{height}", f"{width}x{height}"
            text = f"{place}; if the pictures were that small, give --picture-size {size}: nothing was scaled"
            collector.note(f"{text} to the sensor's {context.sensor}")
            return


Parse = Callable[[str, Path, ImportContext, Collector], Iterable[Picture]]
"""The pictures in the text of a file; raises LabelError if it is not of the format."""


def read_pictures(path: Path, suffix: str, context: ImportContext, parse: Parse) -> Imported:
    """The labels of every file with this suffix in a folder, or of one file; each file lists pictures of its own."""
    collector = Collector()
    add_pictures(unrepeated(parse_files(path, suffix, context, collector, parse), collector), context, collector)
    return collector.done()


def parse_files(path: Path, suffix: str, context: ImportContext, collector: Collector, parse: Parse) -> list[Picture]:
    """The pictures of every file with this suffix in a folder, or of one file."""
    pictures: list[Picture] = []
    for file in files_at(path, suffix, collector):
        text = read_text(file, collector)
        if text is not None:
            with collector.entry(file, 1):
                pictures += parse(text, file, context, collector)
    return pictures


def unrepeated(pictures: Sequence[Picture], collector: Collector) -> list[Picture]:
    """The pictures without those of files that list the same ones as another file."""
    same = SamePictures()
    for picture in pictures:
        same.add(picture.file, picture.names)
    kept = {file for file in dict.fromkeys(picture.file for picture in pictures) if same.accept(file, collector)}
    return [picture for picture in pictures if picture.file in kept]


def add_pictures(pictures: Sequence[Picture], context: ImportContext, collector: Collector) -> None:
    """Add the labels of pictures; each picture and each shape becomes a label or a rejection."""
    counts = range(max((len(picture.names) for picture in pictures), default=0))
    names = ((picture.names[k] for picture in pictures if len(picture.names) > k) for k in counts)
    times = [PictureTimes.of(some, context) for some in names]
    scaling = scaling_of((size for one in pictures for size in one.sizes or (one.size,)), context, collector)
    for picture in pictures:
        file, place = picture.file, Place(picture, times, scaling)
        with collector.entry(file, picture.line):
            label = picture.whole(place)
            if label is not None:
                collector.add(label, file, picture.line)
                continue
            for shape in picture.shapes:
                with collector.entry(file, shape.line):
                    collector.add(shape.label(place), file, shape.line)


class SamePictures:
    """Finds files of one import that list the same pictures: of two clips (mareksubocz/TrackNet#2), or two persons."""

    def __init__(self) -> None:
        self._first: dict[str, Path] = {}
        self._clashes: dict[Path, tuple[Path, str]] = {}

    def add(self, file: Path, pictures: Iterable[str]) -> None:
        """Remember the pictures of a file."""
        for picture in pictures:
            other = self._first.setdefault(picture, file)
            if other != file and picture:
                self._clashes.setdefault(file, (other, picture))
                self._clashes.setdefault(other, (file, picture))

    def accept(self, file: Path, collector: Collector) -> bool:
        """Whether a file is the only one with its pictures; otherwise it is rejected."""
        if file not in self._clashes:
            return True
        other, picture = self._clashes[file]
        what = "the same pictures are in several files: of two clips or two persons?"
        got = f"{picture[:100]!r} in {other.name} too"
        collector.reject(file, 1, LabelError(what, got=got, remedy="import one of the files"))
        return False
