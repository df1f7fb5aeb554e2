"""Which format a file is, by its content; file names are not looked at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import h5py

from core.errors import RecordingError
from core.events import SensorSize
from core.recordings.sources.aedat2 import open_aedat2
from core.recordings.sources.aedat3 import open_aedat3
from core.recordings.sources.aedat4 import open_aedat4
from core.recordings.sources.dat import open_dat
from core.recordings.sources.event_stream import open_es
from core.recordings.sources.folders import camera_files, camera_names
from core.recordings.sources.hdf5_reading import explain
from core.recordings.sources.hdf5_tables import open_hdf5_table
from core.recordings.sources.matlab import MAT5_MAGIC, open_matlab
from core.recordings.sources.metavision_hdf5 import open_metavision_hdf5
from core.recordings.sources.numpy_files import open_archive, open_numpy, pickled
from core.recordings.sources.prophesee_header import read_prophesee_header, text_follows
from core.recordings.sources.prophesee_raw import open_prophesee_raw
from core.recordings.sources.readers import HEAD_BYTES, READERS, Recognise, recognised, register_reader
from core.recordings.sources.ros import open_bag
from core.recordings.sources.ros.bags import MCAP_MAGIC, ROS1_MAGIC, SQLITE_MAGIC, is_bag_folder
from core.recordings.sources.sony_rallies import is_sony_file, is_sony_folder, open_sony_file, open_sony_folder
from core.recordings.sources.source import EventSource, FactOrigin
from core.recordings.sources.text import is_text_below_comments, open_text
from core.text import compression_of

FORMATS: Final = (
    "Prophesee RAW and DAT, AEDAT4, Event Stream, HDF5 (Metavision, DSEC, MVSEC and others), npz, npy, MATLAB, CSV,"
    " bags of ROS or MCAP"
)
FOLDERS: Final = "a bag of ROS 2, a rally of Sony's, or an event file for each camera"
"""Folders that are one recording."""


def open_sources(path: Path, sensor: SensorSize | None = None) -> list[EventSource]:
    """One source for each camera in an event file of any format but ours; `sensor` overrides what the file says.

    Raises:
        RecordingError: if the file is missing, empty, of no known format, or damaged at its very beginning.
    """
    found = _open_folder(path, sensor) if path.is_dir() else _open_file(path, sensor)
    if sensor is None:
        return found
    return [replace(source, sensor_from=FactOrigin.OPTION) for source in found]


def _open_file(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    try:
        if not path.is_file() and path.exists():  # a terminal or a disk: reading might never end
            raise RecordingError("not a file", got="a device", where=path, remedy="give the event file itself")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise RecordingError("the file cannot be opened", got=error.strerror, where=path) from error
    if not head:
        raise RecordingError("the file is empty", where=path)
    if head.startswith(b"version https://git-lfs"):
        remedy = "fetch the file itself: git lfs pull"
        raise RecordingError("the file is a pointer of Git LFS, not the file it stands for", where=path, remedy=remedy)
    if head.lstrip()[:14].lower().startswith((b"<!doctype html", b"<html")):
        raise RecordingError("the file is a web page: a download has failed", where=path, remedy="fetch it again")
    if (reader := recognised(path, head)) is not None:
        return reader.opens(path, sensor)
    if head[:1] == b"\x80" and head[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"):
        raise pickled(path)
    if (packed := compression_of(head)) is not None:
        remedy = "unpack it first"
        raise RecordingError(f"the file is compressed ({packed}), and is not unpacked here", where=path, remedy=remedy)
    for starts, what, remedy in _KNOWN_OTHERS:
        if head.startswith(starts):
            raise RecordingError(f"the file is {what}, and holds no events that can be read", where=path, remedy=remedy)
    others = [reader.label for name, reader in READERS.items() if not READERS.is_built_in(name)]
    raise RecordingError("the format is not recognised", expected=", ".join([*others, FORMATS]), where=path)


def _open_folder(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    if (reader := recognised(path, b"")) is not None:
        return reader.opens(path, sensor)
    files = camera_files(path)
    if files:
        return _open_files(files, sensor)
    raise RecordingError("a folder without events", expected=FOLDERS, where=path, remedy="give the event file itself")


def _open_files(files: list[Path], sensor: SensorSize | None) -> list[EventSource]:
    """Every camera of several files, called as its file."""
    found: list[EventSource] = []
    for file, name in zip(files, camera_names(files), strict=True):
        sources = open_sources(file, sensor)
        found += [replace(source, name=name) for source in sources] if len(sources) == 1 else sources
    return found


def _open_hdf5(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    try:
        with h5py.File(path, "r") as file:
            groups = ", ".join(map(str, file)) or "nothing"
            if "rallyscope" in str(file.attrs.get("format", "")):
                raise RecordingError("it is a recording already", where=path, remedy="open it as it is")
            frames = [str(name) for name, item in file.items() if item is not None and "pandas_type" in item.attrs]
            elsewhere = _links_to_other_files(file)
            metavision, sony = isinstance(file.get("CD/events"), h5py.Dataset), is_sony_file(file)
        if metavision:
            found = open_metavision_hdf5(path, sensor)
        elif sony:
            found = open_sony_file(path, sensor)
        else:
            found = open_hdf5_table(path, sensor)
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        raise RecordingError("the HDF5 file cannot be read", got=explain(error), where=path) from error
    if found is None and frames:
        what, got = "a table that pandas packed into blocks (to_hdf)", ", ".join(frames)
        remedy = "write it with to_hdf(..., format='table', data_columns=True), or as a CSV"
        raise RecordingError(
            what, expected="a column or a field each for t, x, y and p", got=got, where=path, remedy=remedy
        )
    if found is None and elsewhere:
        what, remedy = "no events in the file itself: it links to other files", "write the values themselves into it"
        raise RecordingError(what, got=", ".join(elsewhere)[:200], where=path, remedy=remedy)
    if found is None:
        raise RecordingError("no events in a layout that is known", got=f"an HDF5 file of {groups}", where=path)
    return found


def _links_to_other_files(file: h5py.File) -> list[str]:
    """The links at the root and in its groups, with the files that they name."""
    found: list[str] = []
    for group in (file, *(item for item in file.values() if isinstance(item, h5py.Group) and item.file == file)):
        links = {name: group.get(name, getlink=True) for name in group}
        found += [f"{name} -> {one.filename}" for name, one in links.items() if isinstance(one, h5py.ExternalLink)]
    return found


def _open_aedat(path: Path, sensor: SensorSize | None) -> list[EventSource]:
    with path.open("rb") as file:
        got = file.readline(HEAD_BYTES).decode("ascii", "replace").strip()
    if got.startswith(("#!AER-DAT2.0", "#!AER-DAT1.0")):
        if is_text_below_comments(path):
            return open_text(path, sensor)
        return open_aedat2(path, sensor)
    if got.startswith("#!AER-DAT3"):
        return open_aedat3(path, sensor)
    if not got.startswith("#!AER-DAT4"):
        expected = "AEDAT4, AEDAT 3.1 or AEDAT 2.0"
        raise RecordingError("an older AEDAT version", expected=expected, got=got, where=path)
    return open_aedat4(path, sensor)


def _is_dat(path: Path, head: bytes) -> bool:
    return head.startswith(b"%") and read_prophesee_header(path).is_dat


def _is_raw(path: Path, head: bytes) -> bool:
    if not head.startswith(b"%"):
        return False
    header = read_prophesee_header(path)
    if header.version is None and text_follows(path, header):  # `% geometry 640x480` above lines of numbers
        return False
    return not header.is_dat and (header.version is not None or header.sensor is not None)


def _is_bag(path: Path, head: bytes) -> bool:
    return head.startswith((ROS1_MAGIC, MCAP_MAGIC, SQLITE_MAGIC)) if head else is_bag_folder(path)


def _is_sony_folder(path: Path, head: bytes) -> bool:
    return not head and is_sony_folder(path)


def _is_text(path: Path, head: bytes) -> bool:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) and b"\x00" in head[:16]:  # UTF-16
        return True
    for zeros, letters in ((head[1::2], head[0::2]), (head[0::2], head[1::2])):  # UTF-16 without its mark
        if (
            len(zeros) > 4
            and not zeros.strip(b"\x00")
            and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in letters)
        ):
            return True
    return all(byte >= 32 or byte in b"\t\r\n\f" for byte in head) and 127 not in head


_KNOWN_OTHERS: Final[tuple[tuple[tuple[bytes, ...], str, str], ...]] = (
    ((b"\x89PNG", b"\xff\xd8\xff", b"BM", b"GIF8", b"II*\0", b"MM\0*"), "a picture", "pictures come with --frames"),
    ((b"\0\x05\x16\x07",), "one that macOS lays beside another (._NAME)", "give the file without ._ in its name"),
    ((b"PAR1",), "a Parquet file", "write t, x, y and p to a CSV or an .npz"),
    ((b"ARROW1", b"FEA1"), "a Feather (Arrow) file", "write t, x, y and p to a CSV or an .npz"),
)
"""How files of other kinds begin, what they are, and what to do."""


def _starts_with(*starts: bytes) -> Recognise:
    return lambda path, head: head.startswith(starts)


# The last that recognises a file opens it: what can be anything stands first.
register_reader("text", _is_text, open_text, "CSV", (".csv",), (".csv",))
register_reader("hdf5", lambda path, head: h5py.is_hdf5(path), _open_hdf5, "HDF5", (".hdf5",), (".h5", ".hdf5"))
register_reader("prophesee-raw", _is_raw, open_prophesee_raw, "Prophesee RAW", (".raw",))
register_reader("prophesee-dat", _is_dat, open_dat, "Prophesee DAT", (".dat",))
register_reader("numpy", _starts_with(b"\x93NUMPY"), open_numpy, "NumPy", (".npy",))
register_reader("matlab", _starts_with(MAT5_MAGIC), open_matlab, "MATLAB", (".mat",))
register_reader("numpy-archive", _starts_with(b"PK\x03\x04"), open_archive, "NumPy", (".npz",), (".npz",))
_BAGS: Final = (".bag", ".mcap", ".db3")
register_reader("sony", _is_sony_folder, open_sony_folder, "rally of Sony's", folders=True)
register_reader("bag", _is_bag, open_bag, "bag of ROS", _BAGS, _BAGS, folders=True)
register_reader("event-stream", _starts_with(b"Event Stream"), open_es, "Event Stream", (".es",))
register_reader("aedat4", _starts_with(b"#!AER-DAT"), _open_aedat, "AEDAT", (".aedat4", ".aedat"))
READERS.mark_built_in()
