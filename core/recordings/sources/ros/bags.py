"""The messages of a bag, topic by topic: ROS 1 (.bag), ROS 2 (a folder, .db3) and MCAP, told apart by their content.

rosbags reads the bags of ROS, mcap the MCAP files: also those that no ROS wrote, and those that were cut short.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from core.errors import RecordingError
from core.files import utf8_path
from core.recordings.sources.ros.cut_bags import is_cut_db3, scan_db3, scan_ros1

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

ROS1_MAGIC: Final = b"#ROSBAG V"
MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
SQLITE_MAGIC: Final = b"SQLite format 3\x00"
_REMEDY: Final = "pip install 'rallyscope[ros]'"


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of a bag."""

    name: str
    type: str
    """As ROS 2 spells it: sensor_msgs/msg/Image."""
    definition: str
    """Definition of the message and of those in it, as text; "" where the bag does not hold it."""
    ros1: bool
    """Whether the messages are serialised as in ROS 1, and not in CDR."""
    count: int


@dataclass(slots=True)
class Bag:
    """An opened bag. Messages can be read as often as wanted; it has no state but its notes."""

    path: Path
    topics: dict[str, Topic]
    _read: _Read
    notes: list[str] = field(default_factory=list)
    """What was seen while it was read: where a file was cut short."""

    def messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Time of the bag (ns) and bytes of every message of one topic, in order of time."""
        return self._read(self, topic)


class _Read(Protocol):
    def __call__(self, bag: Bag, topic: str) -> Iterator[tuple[int, bytes]]: ...


def is_bag_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2: its metadata, or at least one of its files."""
    return (path / "metadata.yaml").is_file() or bool(_storage_files(path))


def open_messages(path: Path) -> Bag:
    """The topics of a bag.

    Raises:
        RecordingError: if it cannot be read, or the library for it is missing.
    """
    try:
        import mcap  # noqa: F401
        import rosbags  # noqa: F401
    except ImportError as error:
        raise RecordingError("a bag needs the libraries rosbags and mcap", where=path, remedy=_REMEDY) from error
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            return _open_loose(path)
        return _open_rosbags(path, "ROS 2")
    with path.open("rb") as file:
        head = file.read(16)
    if head.startswith(MCAP_MAGIC):
        return _open_mcap(path)
    return _open_rosbags(path, "ROS 1" if head.startswith(ROS1_MAGIC) else "ROS 2")


def _storage_files(folder: Path) -> list[Path]:
    return sorted(item for item in folder.iterdir() if item.suffix.lower() in (".mcap", ".db3") and item.is_file())


def _open_loose(folder: Path) -> Bag:
    """A folder that lost its metadata, as that of a recorder that was killed: its only file."""
    files = _storage_files(folder)
    if len(files) != 1:
        got = f"{len(files)} files without it"
        raise RecordingError("the bag has no metadata.yaml", got=got, where=folder, remedy="ros2 bag reindex FOLDER")
    bag = open_messages(files[0])
    bag.notes.append(f"{folder.name}: metadata.yaml is missing; {files[0].name} was read without it.")
    return bag


def _rosbags_reader(path: Path, kind: str, stack: ExitStack) -> Reader1 | Reader2:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    path = stack.enter_context(utf8_path(path))
    if kind == "ROS 1":
        return stack.enter_context(Reader1(path))
    reader = Reader2(path if path.suffix == ".db3" or path.is_dir() else _named_db3(path, stack))
    assert path.is_dir() or isinstance(reader.storage, Sqlite3Reader)
    return stack.enter_context(reader)


def _named_db3(path: Path, stack: ExitStack) -> Path:
    """The library tells formats by their names only; a link has the right one."""
    from tempfile import TemporaryDirectory

    link = Path(stack.enter_context(TemporaryDirectory(prefix="rallyscope-"))) / "bag.db3"
    link.symlink_to(path.resolve())
    return link


def _open_rosbags(path: Path, kind: str) -> Bag:
    # SQLite may open a file that was cut, and stop at its index of times, which lies at the end.
    if kind == "ROS 2" and path.is_file() and is_cut_db3(path) and (cut := _open_cut_bag(path, kind)) is not None:
        return cut
    with ExitStack() as stack:
        try:
            connections = _rosbags_reader(path, kind, stack).connections
            topics: dict[str, Topic] = {}
            for one in connections:
                before = topics[one.topic].count if one.topic in topics else 0
                definition = one.msgdef.data if one.msgdef.format.name == "MSG" else ""
                topics[one.topic] = Topic(one.topic, one.msgtype, definition, kind == "ROS 1", before + one.msgcount)
        except Exception as error:
            if path.is_file() and (cut := _open_cut_bag(path, kind)) is not None:
                return cut
            raise RecordingError(f"the {kind} bag cannot be read", got=_reason(error), where=path) from error

    def read(bag: Bag, topic: str) -> Iterator[tuple[int, bytes]]:
        with ExitStack() as stack:
            try:
                reader = _rosbags_reader(path, kind, stack)
                wanted = [one for one in reader.connections if one.topic == topic]
                for _, time_ns, data in reader.messages(wanted):  # pyright: ignore[reportArgumentType]
                    yield time_ns, data
            except Exception as error:  # noqa: BLE001
                bag.notes.append(
                    f"{path.name}, {topic}: stopped: the rest of the bag cannot be read ({_reason(error)})."
                )

    return Bag(path, topics, read)


def _open_cut_bag(path: Path, kind: str) -> Bag | None:
    """A bag without its end, as far as it is whole; None if not even a topic is."""
    scan = scan_ros1 if kind == "ROS 1" else scan_db3
    topics: dict[str, Topic] = {}
    with suppress(Exception):  # whatever a torn record or page looks like
        for one in scan(path):
            count = topics[one.topic].count if one.topic in topics else 0
            topics[one.topic] = Topic(
                one.topic, one.type, one.definition, kind == "ROS 1", count + (one.data is not None)
            )
    if not topics:
        return None

    def read(bag: Bag, topic: str) -> Iterator[tuple[int, bytes]]:
        try:
            for one in scan(path):
                if one.topic == topic and one.data is not None:
                    yield one.time_ns, one.data
        except Exception:  # noqa: BLE001
            pass
        _note_cut(bag)

    return Bag(path, topics, read)


def _note_cut(bag: Bag) -> None:
    note = f"{bag.path.name}: the file was cut short; what is whole was read."
    if note not in bag.notes:
        bag.notes.append(note)


def _open_mcap(path: Path) -> Bag:
    from mcap.reader import make_reader

    cut_short = False
    with path.open("rb") as file:
        try:
            summary = make_reader(file).get_summary()
            cut_short = summary is None or not summary.channels
        except Exception:  # noqa: BLE001 (without an end there is no summary either)
            cut_short = True
            summary = None
    if cut_short or summary is None:
        return _open_cut_mcap(path)
    counts = summary.statistics.channel_message_counts if summary.statistics is not None else {}
    topics: dict[str, Topic] = {}
    for number, channel in summary.channels.items():
        schema = summary.schemas.get(channel.schema_id)
        # Several channels may publish on one topic.
        before = topics[channel.topic].count if channel.topic in topics else 0
        topics[channel.topic] = _mcap_topic(channel, schema, before + counts.get(number, 0))

    def read(bag: Bag, topic: str) -> Iterator[tuple[int, bytes]]:
        with path.open("rb") as file:
            try:
                for _, _, message in make_reader(file).iter_messages(topics=[topic]):
                    yield message.log_time, message.data
            except Exception as error:  # noqa: BLE001
                bag.notes.append(f"{path.name}, {topic}: stopped: the rest cannot be read ({_reason(error)}).")

    return Bag(path, topics, read)


def _open_cut_mcap(path: Path) -> Bag:
    """A file without its end: one pass finds the topics, another reads, as far as there are whole chunks."""
    from mcap.reader import NonSeekingReader

    topics: dict[str, Topic] = {}

    def scan(topic: str | None) -> Iterator[tuple[int, bytes]]:
        with path.open("rb") as file:
            for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
                if topic is None:
                    before = topics[channel.topic].count if channel.topic in topics else 0
                    topics[channel.topic] = _mcap_topic(channel, schema, before + 1)
                elif channel.topic == topic:
                    yield message.log_time, message.data

    def read(bag: Bag, topic: str) -> Iterator[tuple[int, bytes]]:
        with contextlib.suppress(Exception):  # whatever a torn record looks like to the library
            yield from scan(topic)
        _note_cut(bag)

    try:
        for _ in scan(None):
            pass
    except Exception as error:
        if not topics:
            raise RecordingError("the MCAP file cannot be read", got=_reason(error), where=path) from error
    return Bag(path, topics, read)


def _mcap_topic(channel: object, schema: object, count: int) -> Topic:
    name, encoding = (str(getattr(schema, key, "")) for key in ("name", "encoding"))
    definition = getattr(schema, "data", b"").decode("utf-8", "replace") if encoding in ("ros1msg", "ros2msg") else ""
    package, _, short = name.partition("/")
    kind = f"{package}/msg/{short}" if short and "/" not in short else name
    ros1 = getattr(channel, "message_encoding", "") == "ros1"
    return Topic(str(getattr(channel, "topic", "")), kind, definition, ros1, count)


def _reason(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
