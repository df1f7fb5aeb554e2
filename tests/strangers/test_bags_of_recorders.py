"""Public reports about bags of ROS 2 that a recorder left without their end or with wrong numbers, each made here."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from core.errors import RecordingError
from core.recordings.sources import open_sources

if find_spec("rosbags") is None:
    pytest.skip("needs the extra ros", allow_module_level=True)

from core.events import concatenate_events
from core.recordings.sources.source import DecodeReport, EventSource
from tests.core.recordings.sources.ros.bag_writing import EPOCH_S, BagMaker

T0_US = EPOCH_S * 1_000_000
EVENTS = [(T0_US + 100 * k, k % 346, k % 260, k % 3 == 0) for k in range(40)]


def write_bag(folder: Path, parts: list[list[tuple[int, int, int, bool]]]) -> Path:
    """A bag with a message for each part."""
    with BagMaker(folder, "ros2") as bag:
        for part in parts:
            bag.add_events("/dvs/events", part)
    return folder


def rows_of(source: EventSource) -> list[tuple[int, int, int, bool]]:
    events = concatenate_events(list(source.read(DecodeReport())), source.sensor)
    columns = (events.t_us, events.x_px, events.y_px, events.on)
    return list(zip(*(column.tolist() for column in columns), strict=True))


def test_a_bag_without_its_metadata_is_read(tmp_path: Path) -> None:
    """ros2/rosbag2#395: without metadata.yaml a .db3 could not be opened. Was right."""
    bag = write_bag(tmp_path / "bag", [EVENTS[:20], EVENTS[20:]])
    (bag / "metadata.yaml").unlink()
    (source,) = open_sources(bag)
    assert rows_of(source) == EVENTS


@pytest.mark.parametrize("key", ["nanoseconds:", "nanoseconds_since_epoch:"])
def test_wrong_times_in_the_metadata_are_not_used(key: str, tmp_path: Path) -> None:
    """ros2/rosbag2#966 and #1413: start and duration were those of the last part of a bag. Was right."""
    bag = write_bag(tmp_path / "bag", [EVENTS[:20], EVENTS[20:]])
    text = (bag / "metadata.yaml").read_text()
    lines = [f"{line.split(':')[0]}: 5" if line.strip().startswith(key) else line for line in text.splitlines()]
    (bag / "metadata.yaml").write_text("\n".join(lines))
    assert text != (bag / "metadata.yaml").read_text()
    (source,) = open_sources(bag)
    assert rows_of(source) == EVENTS


def test_messages_that_were_written_out_of_order_are_sorted(tmp_path: Path) -> None:
    """ros2/rosbag2#842: who writes a bag with the library may write its messages in any order. Was right."""
    (source,) = open_sources(write_bag(tmp_path / "bag", [EVENTS[20:], EVENTS[:20]]))
    assert rows_of(source) == EVENTS


def test_parts_of_a_bag_without_metadata_are_not_put_in_an_order_of_our_own(tmp_path: Path) -> None:
    """ros2/rosbag2#1511: the parts of one bag, in a folder of their own. Was refused with the remedy already."""
    folder = tmp_path / "parts"
    folder.mkdir()
    for number in (2, 10):
        bag = write_bag(tmp_path / f"bag{number}", [EVENTS])
        (part,) = bag.glob("*.db3")
        shutil.copy(part, folder / f"bag_{number}.db3")
    with pytest.raises(RecordingError, match=r"no metadata\.yaml; got 2 files without it.*reindex"):
        open_sources(folder)
