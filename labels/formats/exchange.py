"""What every exchange format shares: what is written, what comes back, how pictures are named, what is rejected."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from core.errors import LabelError, PluginError
from core.events import SensorSize
from core.files import replace_file
from core.registry import Registry
from labels.model import Label, LabelState, PositionSource, Provenance

CLASS_NAME = "ball"
MAX_FILE_BYTES = 1 << 30
_OURS = re.compile(r"_t(\d{12,19})us$")
_NUMBER = re.compile(r"(\d{1,18})(?!.*\d)")


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

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Imported:
    """Labels by time, and everything that was rejected."""

    labels: tuple[Label, ...]
    rejections: tuple[Rejection, ...]


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

    def time_of(self, picture: str) -> int:
        """The time of a picture from its name: ours hold it, others end with a number into `frame_times_us`.

        Raises:
            LabelError: if the name does not tell.
        """
        stem = picture.replace("\\", "/").rsplit("/", 1)[-1]
        stem = stem[: stem.rindex(".")] if "." in stem else stem
        ours = _OURS.search(stem)
        if ours:
            return int(ours[1])
        number = _NUMBER.search(stem)
        if number is None:
            raise LabelError("a picture without a number in its name", got=repr(picture[:200]))
        return self.time_of_frame(int(number[1]))

    def time_of_frame(self, number: int) -> int:
        """The time of the picture with this number, from 0.

        Raises:
            LabelError: if there is none.
        """
        if self.frame_times_us is None:
            raise LabelError("the time of a picture is not known", got=f"frame {number}", remedy="give --frame-times")
        if not 0 <= number < len(self.frame_times_us):
            expected = f"0 to {len(self.frame_times_us) - 1}"
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
        """A label with the provenance of an import."""
        origin = Provenance(source=PositionSource.IMPORTED, detector=self.origin)
        return Label(t_us=t_us, state=state, x_px=x_px, y_px=y_px, r_px=r_px, provenance=origin)


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


FORMATS: Final[Registry[LabelFormat]] = Registry("label format", "rallyscope.label_formats")
"""Every format by name."""


def register_label_format(
    name: str, write: Writer, read: Reader, label: str, summary: str = "", *, pictures: bool = False
) -> None:
    """Add a format of labels: to `labels import` and `labels export`, and to the app's list of formats.

    Args:
        name: of the format, on the command line.
        write: writes the labels of one camera into a folder, and says what the format cannot hold.
        read: reads a file or a folder; what does not become a label is rejected, with its line.
        label: what the app calls it; empty: it is for the command line only.
        summary: a line of help; empty: the label.
        pictures: whether its tools want the pictures beside it.

    Raises:
        PluginError: if the name is taken, or one of these does not fit.
    """
    where = f"label format {name}"
    if not callable(write) or not callable(read):
        expected = "write(labels, folder, options) and read(path, context)"
        raise PluginError("no way to write and read it", expected=expected, where=where)
    if not isinstance(label, str) or not (summary or label).strip():
        raise PluginError("no label", expected="what the format is called", got=repr(label), where=where)
    FORMATS.register(name, LabelFormat(name, summary or label, write, read, pictures, label))


class Collector:
    """Gathers labels while files are read: every entry ends as a label or as a rejection with its place."""

    def __init__(self) -> None:
        self._labels: dict[int, Label] = {}
        self._rejections: list[Rejection] = []

    def reject(self, file: Path, line: int, reason: object) -> None:
        """Note that something was not taken."""
        self._rejections.append(Rejection(file, line, " ".join(str(reason).split())[:500]))

    @contextmanager
    def entry(self, file: Path, line: int) -> Iterator[None]:
        """Inside, an impossible value rejects this entry and reading goes on."""
        try:
            yield
        except (LabelError, ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
            text = f"missing {error}" if isinstance(error, KeyError) else error
            self.reject(file, line, text)

    def add(self, label: Label, file: Path, line: int) -> None:
        """Take a label; a second one of the same time is rejected."""
        if label.t_us in self._labels:
            self.reject(file, line, f"a second label at {label.t_us} us; the first one is kept")
        else:
            self._labels[label.t_us] = label

    def done(self) -> Imported:
        """Give back what was gathered."""
        return Imported(tuple(label for _, label in sorted(self._labels.items())), tuple(self._rejections))


def picture_name(camera: str, t_us: int) -> str:
    """Name of the picture of a time, without its suffix: it holds the identity, so no list has to."""
    return f"{quote(camera, safe='').replace('.', '%2E')}_t{t_us:012d}us"


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


def read_text(file: Path, collector: Collector) -> str | None:
    """The text of a file, or None after a rejection."""
    try:
        if file.stat().st_size > MAX_FILE_BYTES:
            collector.reject(file, 1, f"larger than {MAX_FILE_BYTES >> 20} MiB")
            return None
        content = file.read_bytes()
    except OSError as error:
        collector.reject(file, 1, error.strerror or error)
        return None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        collector.reject(file, 1 + content.count(b"\n", 0, error.start), f"not UTF-8 text: {error.reason}")
        return None


def table_rows(text: str, file: Path, collector: Collector) -> Iterator[tuple[int, list[str]]]:
    """Rows of a CSV text that are not empty, with their line numbers; what follows one that is none is rejected."""
    # Every kind of line end becomes one that the reader knows.
    reader = csv.reader(io.StringIO(text.replace("\0", "\ufffd"), newline=None))
    try:
        for fields in reader:
            if fields:
                yield reader.line_num, fields
    except csv.Error as error:
        collector.reject(file, reader.line_num + 1, f"not CSV from here on: {error}")


def files_at(path: Path, suffix: str, collector: Collector) -> list[Path]:
    """The file itself, or all files with this suffix in a folder; rejects a path where there is nothing."""
    if path.is_file():
        return [path]
    found = sorted(file for file in path.glob(f"*{suffix}") if file.is_file()) if path.is_dir() else []
    if not found:
        collector.reject(path, 1, f"no {suffix} files here")
    return found


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
