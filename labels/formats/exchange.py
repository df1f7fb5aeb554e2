"""What every exchange format shares: what is written, what comes back, how pictures are named, what is rejected."""

from __future__ import annotations

import csv
import io
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError, PluginError, RallyscopeError
from core.events import Events, SensorSize
from core.files import file_stem, replace_file
from core.foreign_tables import separator_of, with_point
from core.registry import Registry
from core.text import compression_of, decode_text, encoding_of
from labels.model import ContactLabel, Label, LabelState, PositionSource, Provenance

CLASS_NAME = "ball"
HALF_PIXEL = 0.5
"""From our pixel-centre convention to formats in which 0 is the outer edge of the first pixel."""
SMALLEST_PX = 0.5
"""Radius of another tool's ball."""
NO_TIME = -(2**63)
"""In a table of times, of a number that it does not list."""
MAX_FILE_BYTES = 1 << 30
_STATED_SEPARATOR = re.compile(r'"?sep=([,;\t|])"?', re.IGNORECASE)
_VALUES = re.compile(r"'[^']*'|\"[^\"]*\"|[-+]?\d+(\.\d+)?")


@dataclass(frozen=True, slots=True)
class LabelSet:
    """Labels of one camera that are to be exported."""

    recording_uuid: str
    camera: str
    annotator: str
    sensor: SensorSize
    labels: tuple[Label, ...]
    """By time."""
    frames_us: tuple[int, ...] | None = None
    """Every picture of the clip, labelled or not, for formats that have a row for each; None: the labelled ones."""
    contacts: tuple[ContactLabel, ...] = ()
    """Bounces, hits and net touches, by time; for formats that hold them."""

    @property
    def unchecked_us(self) -> tuple[int, ...]:
        """Pictures that nobody looked at."""
        checked = {label.t_us for label in self.labels}
        return tuple(t_us for t_us in self.frames_us or () if t_us not in checked)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """Choices that some formats leave."""

    default_radius_px: float = 8.0
    """Half the box of a label without a radius: formats of boxes need one."""
    whole_pixels: bool = True
    """Pascal VOC and TrackNet: round to whole pixels as their own tools do; otherwise decimals."""
    own_extras: bool = True
    """Pascal VOC: add an element that other tools ignore and that makes our own import lossless."""
    drop_unchecked: bool = False
    """TrackNet: leave pictures out that nobody looked at, instead of refusing."""


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written, and what the format could not hold: one line for each kind of loss, with its count."""

    files: tuple[Path, ...]
    losses: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Rejection:
    """Something in a file that did not become a label."""

    file: Path
    line: int
    reason: str
    kind: str = ""
    """The reason without the values of this entry: rejections are counted by it."""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Imported:
    """Labels by time, and everything that was rejected."""

    labels: tuple[Label, ...]
    rejections: tuple[Rejection, ...]
    files: int = 0
    """How many were looked into."""
    notes: tuple[str, ...] = ()
    """What was found elsewhere, or scaled: a line each."""
    places: tuple[tuple[Path, int], ...] = ()
    """File and line of each label; empty if they are not known."""
    contacts: tuple[ContactLabel, ...] = ()
    """Bounces, hits and net touches, by time."""


@dataclass(frozen=True, slots=True, eq=False)
class ImportContext:
    """What the files do not say."""

    sensor: SensorSize
    frame_times_us: NDArray[np.int64] | None = None
    """Time of each picture by its number, for pictures that are not named by their time."""
    origin: str = ""
    """Noted as the source of the labels."""
    camera: str = ""
    """Which camera, for files that hold several."""
    clock_us: int = 0
    """The camera's own time at the start of the recording, for files that count on it."""

    times_by_name: Mapping[str, int] | None = None
    """Time of each picture by its name, as `stem_of` makes it."""
    ball_class: str | None = None
    """Name or number of the class that is the ball; None: the one that is called so."""
    scale_pictures: bool = False
    """Whether labels on pictures of another size than the sensor's are scaled, if all have the same."""
    picture_size: tuple[int, int] | None = None
    """Width and height of the pictures that were labelled, where the files do not state them; None: the sensor's."""
    empty_pictures: LabelState | None = None
    """What a listed picture without any annotation is; None: nobody looked at it, unless the tool says otherwise."""
    other_cameras: tuple[str, ...] = ()
    """The other cameras of the recording: pictures and files of theirs are refused."""
    recording_uuid: str = ""
    """The recording; empty: not known."""
    end_us: int | None = None
    """Where the recording ends."""
    events_between: Callable[[int, int], Events] | None = None
    """The camera's events from a time up to another, us; None: there are none to look at."""

    def is_ball(self, name: str) -> bool:
        """Whether a class of this name is the ball."""
        return _folded(name) == _folded(self.ball_class or CLASS_NAME)

    @property
    def stated_factors(self) -> tuple[float, float]:
        """From pixels of pictures whose size is stated by `picture_size` to the sensor's, along x and y."""
        width, height = self.picture_size or (self.sensor.width_px, self.sensor.height_px)
        return self.sensor.width_px / width, self.sensor.height_px / height

    def time_of_frame(self, number: int) -> int:
        """The time of the picture with this number, from 0.

        Raises:
            LabelError: if there is none.
        """
        if self.frame_times_us is None:
            raise LabelError("the time of a picture is not known", got=f"frame {number}", remedy="give --frame-times")
        if not 0 <= number < len(self.frame_times_us) or self.frame_times_us[number] == NO_TIME:
            listed = np.flatnonzero(self.frame_times_us != NO_TIME)
            expected = f"{listed[0]} to {listed[-1]}" if len(listed) else "none: the table is empty"
            raise LabelError("no such frame", expected=expected, got=number)
        return int(self.frame_times_us[number])

    def make(
        self,
        t_us: int,
        state: LabelState,
        x_px: float | None = None,
        y_px: float | None = None,
        r_px: float | None = None,
    ) -> Label:
        """A label with the provenance of an import.

        Args:
            t_us: time in the recording.
            state: visible, hidden, ...
            x_px: column, counted from the middle of the first pixel.
            y_px: row.
            r_px: radius; None: not known.
        """
        origin = Provenance(source=PositionSource.IMPORTED, detector=self.origin)
        return Label(t_us=t_us, state=state, x_px=x_px, y_px=y_px, r_px=r_px, provenance=origin)

    def ball(self, t_us: int, state: LabelState, x_px: float | None, y_px: float | None, r_px: float | None) -> Label:
        """Like `make`, of another tool's ball: one whose centre or size no picture of this sensor can hold is refused.

        Args:
            t_us: time in the recording.
            state: visible, hidden, ...
            x_px: column, counted from the middle of the first pixel.
            y_px: row.
            r_px: radius; None: not known.

        Raises:
            LabelError: if it is impossible.
        """
        width, height = self.sensor.width_px, self.sensor.height_px
        if x_px is not None and y_px is not None and state in (LabelState.VISIBLE, LabelState.PARTLY_OCCLUDED):
            if not (-HALF_PIXEL <= x_px <= width - HALF_PIXEL and -HALF_PIXEL <= y_px <= height - HALF_PIXEL):
                got = f"({x_px:.1f}, {y_px:.1f})"
                raise LabelError("the centre is outside the picture", expected=f"within {self.sensor}", got=got)
            if r_px is not None and r_px < SMALLEST_PX:  # shares in COCO: cocodataset/cocoapi#474
                got, remedy = f"radius {r_px:.3g} px", "are these shares of the picture, where pixels belong?"
                raise LabelError("the ball is smaller than a pixel", got=got, remedy=remedy)
            if r_px is not None and 2 * r_px > min(width, height) / 2:  # chuanenlin/drone-net#1
                got, remedy = f"radius {r_px:.1f} px", "are these corners of a box, where its centre and sides belong?"
                raise LabelError("the ball is larger than half of the picture", got=got, remedy=remedy)
        return self.make(t_us, state, x_px, y_px, r_px)

    def unannotated(self, t_us: int) -> Label:
        """The label of a picture that is listed without any annotation.

        Raises:
            LabelError: if the user does not say what that means.
        """
        if self.empty_pictures is None:
            what = "a picture without annotation: nobody may have looked at it"
            raise LabelError(what, remedy="--empty-pictures no-ball if somebody has")
        return self.make(t_us, self.empty_pictures)


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name.strip()).casefold()


Writer = Callable[[LabelSet, Path, ExportOptions], Exported]
Reader = Callable[[Path, ImportContext], Imported]


@dataclass(frozen=True, slots=True)
class LabelFormat:
    """One exchange format: its name, writer and reader."""

    name: str
    summary: str
    write: Writer
    """Into a folder (or, for `hdf5`, a recording)."""
    read: Reader
    """From a folder or file."""
    pictures: bool = False
    """Whether its tools want the pictures beside it."""
    label: str = ""
    """What the app calls it; empty: it is for the command line only."""
    contacts: bool = False
    """Whether it holds contacts too; else they are counted as a loss."""


FORMATS: Final[Registry[LabelFormat]] = Registry("label format", "rallyscope.label_formats")
"""Every format by name."""


def register_label_format(
    name: str,
    write: Writer,
    read: Reader,
    label: str,
    summary: str = "",
    *,
    pictures: bool = False,
    contacts: bool = False,
) -> None:
    """Add a format of labels: to `labels import` and `labels export`, and to the app's list of formats.

    Args:
        name: of the format, on the command line.
        write: writes the labels of one camera into a folder, and says what the format cannot hold.
        read: reads a file or a folder; what does not become a label is rejected, with its line.
        label: what the app calls it; empty: it is for the command line only.
        summary: a line of help; empty: the label.
        pictures: whether its tools want the pictures beside it.
        contacts: whether it writes and reads the contacts of a `LabelSet`.

    Raises:
        PluginError: if the name is taken, or one of these does not fit.
    """
    where = f"label format {name}"
    if not callable(write) or not callable(read):
        expected = "write(labels, folder, options) and read(path, context)"
        raise PluginError("no way to write and read it", expected=expected, where=where)
    if not isinstance(label, str) or not (summary or label).strip():
        raise PluginError("no label", expected="what the format is called", got=repr(label), where=where)
    FORMATS.register(name, LabelFormat(name, summary or label, write, read, pictures, label, contacts))


def rejection_of(file: Path, line: int, reason: object) -> Rejection:
    """A rejection in one line, with what it is counted by."""
    text = " ".join(str(reason).split())[:500]
    kind = reason.what if isinstance(reason, RallyscopeError) else text
    return Rejection(file, line, text, _VALUES.sub("...", kind)[:120])


class DocumentError(LabelError):
    """Text that is not JSON, or not XML, from a line on."""

    def __init__(self, what: str, line: int) -> None:
        super().__init__(what)
        self.line = line


class Collector:
    """Gathers labels while files are read: every entry ends as a label or as a rejection with its place."""

    def __init__(self) -> None:
        self._labels: dict[int, Label] = {}
        self._places: dict[int, tuple[Path, int]] = {}
        self._contacts: dict[int, ContactLabel] = {}
        self._rejections: list[Rejection] = []
        self._notes: list[str] = []
        self.files = 0
        """How many were opened."""

    def reject(self, file: Path, line: int, reason: object) -> None:
        """Say that something was not taken."""
        self._rejections.append(rejection_of(file, line, reason))

    def note(self, text: str) -> None:
        """Say what was found or done for all entries."""
        if text not in self._notes:
            self._notes.append(text)

    def is_of(self, context: ImportContext, file: Path, camera: object, recording: object = None) -> bool:
        """Whether a file that names its camera is of that of the context, or of one that this recording does not have.

        If not it is rejected; another recording is noted, because the same recording may have been imported again.
        """
        if camera in context.other_cameras:
            self.reject(file, 1, LabelError("labels of another camera", expected=context.camera, got=camera))
            return False
        if isinstance(recording, str) and recording and context.recording_uuid not in ("", recording):
            self.note(f"{file.name} says that it is of another recording; its times are taken as those of this one")
        return True

    @contextmanager
    def entry(self, file: Path, line: int) -> Iterator[None]:
        """Inside, an impossible value rejects this entry and reading goes on."""
        try:
            yield
        except DocumentError as error:
            self.reject(file, error.line, error)
        except (LabelError, ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
            text = LabelError(f"missing {error}") if isinstance(error, KeyError) else error
            self.reject(file, line, text)

    def add(self, label: Label, file: Path, line: int) -> None:
        """Take a label; a second one of the same time is rejected."""
        if label.t_us in self._labels:
            self.reject(file, line, LabelError(f"a second label at {label.t_us} us; the first one is kept"))
        else:
            self._labels[label.t_us] = label
            self._places[label.t_us] = (file, line)

    def add_contact(self, contact: ContactLabel, file: Path, line: int) -> None:
        """Take a contact; a second one of the same time is rejected."""
        if contact.t_us in self._contacts:
            self.reject(file, line, LabelError(f"a second contact at {contact.t_us} us; the first one is kept"))
        else:
            self._contacts[contact.t_us] = contact

    def done(self) -> Imported:
        """Give back what was gathered."""
        labels = tuple(label for _, label in sorted(self._labels.items()))
        order = {file: number for number, file in enumerate(dict.fromkeys(item.file for item in self._rejections))}
        rejections = sorted(self._rejections, key=lambda item: (order[item.file], item.line))
        places = tuple(self._places[label.t_us] for label in labels)
        contacts = tuple(contact for _, contact in sorted(self._contacts.items()))
        return Imported(labels, tuple(rejections), self.files, tuple(self._notes), places, contacts)


def picture_name(camera: str, t_us: int) -> str:
    """Name of the picture of a time, without its suffix: it holds the identity, so no list has to."""
    return f"{file_stem(camera)}_t{t_us:012d}us"


def finite(text: object, what: str) -> float:
    """Read a finite number.

    Raises:
        LabelError: if it is none.
    """
    try:
        value = float(text) if isinstance(text, (int, float, str)) and not isinstance(text, bool) else float("nan")
    except (ValueError, OverflowError):
        value = float("nan")
    if not np.isfinite(value):
        raise LabelError(f"{what} is not a finite number", got=repr(text)[:80])
    return value


def whole_number(value: object, what: str) -> int:
    """Read a whole number; `1.0` and `"1"` are 1.

    Raises:
        LabelError: if it is none.
    """
    number = finite(value, what)
    if not number.is_integer() or abs(number) > 2**53:
        raise LabelError(f"{what} is not a whole number", got=repr(value)[:80])
    return int(number)


def read_text(file: Path, collector: Collector) -> str | None:
    """The text of a file, or None after a rejection."""
    try:
        if file.stat().st_size > MAX_FILE_BYTES:
            collector.reject(file, 1, f"larger than {MAX_FILE_BYTES >> 20} MiB")
            return None
        content = file.read_bytes()
        collector.files += 1
    except OSError as error:
        collector.reject(file, 1, error.strerror or error)
        return None
    if (packed := compression_of(content[:512])) is not None:
        collector.reject(file, 1, LabelError(f"the file is compressed ({packed})", remedy="unpack it first"))
        return None
    try:
        text = decode_text(content)
    except UnicodeDecodeError as error:
        collector.reject(file, 1 + content.count(b"\n", 0, error.start), f"not text: {error.reason}")
        return None
    if encoding_of(content) == "latin-1":
        collector.note(f"{file.name} is not UTF-8: read as Latin-1")
    return text


def table_rows(text: str, file: Path, collector: Collector) -> Iterator[tuple[int, list[str]]]:
    """Rows of a CSV text that are not empty, with their line numbers; what follows one that is none is rejected."""
    text, delimiter = without_remarks(text)
    # Every kind of line end becomes one that the reader knows.
    lines = io.StringIO(text.replace("\0", "\ufffd"), newline=None)
    reader = csv.reader(lines, delimiter=delimiter)
    try:
        width = 0
        for fields in reader:
            if fields:
                width = width or len(fields)
                while len(fields) > width and not fields[-1].strip():
                    fields.pop()  # a comma at the end of each line but that of the names (natcap/invest#146)
                # Where fields end with a semicolon, numbers may have a comma.
                whole = fields if delimiter == "," else [with_point(field) for field in fields]
                yield reader.line_num, whole
    except csv.Error as error:
        collector.reject(file, reader.line_num + 1, f"not CSV from here on: {error}")


def without_remarks(text: str) -> tuple[str, str]:
    """A table whose first lines say nothing of it, emptied so that lines keep their numbers, and its separator.

    Excel is told the separator by a line `sep=;`, and many programs write remarks behind `#`. NumPy writes the names of
    the columns like that: they are the last such line if it has as many fields as the row below it.
    """
    if not text.startswith("#") and _STATED_SEPARATOR.match(text) is None:
        return text, separator_of(text)
    lines, first, separator = text.split("\n"), 0, None
    if (stated := _STATED_SEPARATOR.fullmatch(lines[0].strip())) is not None:
        separator, lines[0], first = stated[1], "", 1
    end = next((at for at in range(first, len(lines)) if not lines[at].startswith("#")), len(lines))
    below = "\n".join(lines[end:])
    separator = separator or separator_of(below)
    for at in range(first, end):
        names = lines[at].lstrip("#").strip()
        is_header = at == end - 1 and names.count(separator) == below.partition("\n")[0].count(separator) > 0
        lines[at] = names if is_header and re.match(r"\s*[-+.\d]", below) else ""
    return "\n".join(lines), separator


def add_rows(
    rows: Iterable[tuple[int, list[str]]],
    width: int,
    file: Path,
    collector: Collector,
    label_of: Callable[[list[str]], Label | None],
) -> None:
    """Add the label of each row of `width` fields, if it gives one; a row that is odd is rejected with its line."""
    for line, fields in rows:
        with collector.entry(file, line):
            if len(fields) != width:
                raise LabelError("wrong number of fields", expected=width, got=len(fields))
            if (label := label_of(fields)) is not None:
                collector.add(label, file, line)


def files_at(path: Path, suffix: str, collector: Collector) -> list[Path]:
    """The file itself, or all files with this suffix in a folder, else in the folders below; rejects an empty place."""
    if path.is_file():
        return [path]
    found = _visible(path.iterdir(), suffix) if path.is_dir() else []
    if not found and path.is_dir():
        found = _visible(path.rglob("*"), suffix)
    if not found:
        collector.reject(path, 1, f"no {suffix} files here")
    return found


def _visible(files: Iterable[Path], suffix: str) -> list[Path]:
    """The files of an ending, in capitals too, without the hidden ones that systems leave beside others."""
    return sorted(
        file for file in files if file.suffix.lower() == suffix and not file.name.startswith(".") and file.is_file()
    )


def write_text(file: Path, text: str) -> Path:
    """Write a file in one step: never half of it.

    Raises:
        LabelError: if that fails.
    """
    return write_bytes(file, text.encode())


def write_bytes(file: Path, content: bytes) -> Path:
    """Write a file in one step: never half of it.

    Raises:
        LabelError: if that fails.
    """
    try:
        replace_file(file, content, durable=True)
    except OSError as error:
        raise LabelError("cannot write the export", got=error.strerror, where=file) from error
    return file


def count_losses(losses: Iterable[str]) -> tuple[str, ...]:
    """One line for each kind of loss, with how often it occurred."""
    counts: dict[str, int] = {}
    for loss in losses:
        counts[loss] = counts.get(loss, 0) + 1
    return tuple(f"{count} x {loss}" for loss, count in sorted(counts.items()))
