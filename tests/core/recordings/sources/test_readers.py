"""Formats of event files that are registered."""

from pathlib import Path

import numpy as np
import pytest

from core.errors import PluginError, RecordingError
from core.recordings import open_recording
from core.recordings.sources import open_sources, register_reader
from core.recordings.sources.kinds import RECORDING, kind_of
from core.recordings.sources.readers import READERS, event_files
from core.registry import forgotten_afterwards, use_plugins

EVENT = np.dtype({"names": ["t", "x", "y", "on"], "formats": ["<i8", "<u2", "<u2", "u1"], "itemsize": 16})


def write_evb(path: Path, count: int) -> Path:
    rows = np.zeros(count, EVENT)
    rows["t"], rows["x"], rows["y"], rows["on"] = np.arange(count) * 10, 5, np.arange(count) % 40, 1
    path.write_bytes(b"EVB1" + np.array([64, 48], "<u2").tobytes() + rows.tobytes())
    return path


def test_a_file_of_the_example_is_recognised_read_and_listed(plugins: Path, tmp_path: Path) -> None:
    path = write_evb(tmp_path / "events.evb", 1000)
    assert kind_of(path) is None
    with pytest.raises(RecordingError, match="not recognised; expected Prophesee RAW"):
        open_sources(path)
    with forgotten_afterwards():
        use_plugins([plugins / "binary_reader.py"])
        assert kind_of(path) == "EVB events" and event_files()[".evb"] == "EVB events"
        with open_recording(path) as recording:
            events = recording.cameras["camera"].slice(0, 20_000)
            assert len(events) == 1000 and events.t_us[-1] == 9990 and events.sensor.width_px == 64
        with pytest.raises(RecordingError, match="expected EVB events, Prophesee RAW"):
            open_sources(write_other(tmp_path / "other"))


def test_a_file_that_is_cut_off_gives_what_is_there(plugins: Path, tmp_path: Path) -> None:
    path = write_evb(tmp_path / "events.evb", 1000)
    path.write_bytes(path.read_bytes()[:-3])
    with forgotten_afterwards():
        use_plugins([plugins / "binary_reader.py"])
        with open_recording(path) as recording:
            assert recording.cameras["camera"].event_count == 999
        path.write_bytes(path.read_bytes()[:5])
        with pytest.raises(RecordingError, match="the header is cut off"):
            open_recording(path)


def test_an_odd_address_in_a_file_of_the_example_costs_itself_as_in_ours(plugins: Path, tmp_path: Path) -> None:
    path = write_evb(tmp_path / "events.evb", 1000)
    data = bytearray(path.read_bytes())
    data[8 + 16 * 500 + 8 : 8 + 16 * 500 + 10] = b"\xff\x0f"
    path.write_bytes(data)
    with forgotten_afterwards():
        use_plugins([plugins / "binary_reader.py"])
        with open_recording(path) as recording:
            assert recording.cameras["camera"].event_count == 999
            assert any("1 " in note and "sensor" in note for note in recording.notes), recording.notes


def write_other(path: Path) -> Path:
    path.write_bytes(b"\x00\x01\x02 nothing that anybody knows")
    return path


def test_the_last_that_recognises_a_file_opens_it_but_our_recordings_stay_ours(
    tmp_path: Path, serve_recording: Path
) -> None:
    (tmp_path / "a.csv").write_text("t,x,y,p\n1,2,3,1\n4,5,6,0\n")
    assert open_sources(tmp_path / "a.csv")[0].format != "theirs" and kind_of(tmp_path / "a.csv") == "CSV"
    with forgotten_afterwards():

        def opens(path: Path, sensor: object) -> list:
            raise RecordingError("read by the plugin")

        register_reader("greedy", lambda path, head: True, opens, "All", (".csv",))
        assert kind_of(tmp_path / "a.csv") == "All" and kind_of(serve_recording) == RECORDING
        with pytest.raises(RecordingError, match="read by the plugin"):
            open_sources(tmp_path / "a.csv")
        with open_recording(serve_recording) as recording:
            assert set(recording.cameras) == {"left", "right"}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"name": "text"}, "there is a reader 'text' already"),
        ({"opens": None}, "no way to read it"),
        ({"label": ""}, "no label"),
        ({"suffixes": ("xyz",)}, "not suffixes"),
        ({"suffixes": ".xyz"}, "not suffixes"),
    ],
)
def test_a_reader_that_does_not_fit_is_refused(given: dict, said: str) -> None:
    whole = {"name": "new", "recognises": bool, "opens": list, "label": "New", "suffixes": (".new",), **given}
    with forgotten_afterwards(), pytest.raises(PluginError, match=said):
        register_reader(whole.pop("name"), **whole)
    assert "new" not in READERS


@pytest.mark.parametrize(
    ("name", "head", "kind"),
    [
        ("a.aedat", b"#!AER-DAT2.0\r\n", "AEDAT"),
        ("a.aedat", b"#!AER-DAT3.1\r\n", "AEDAT"),
        ("a.aedat4", b"#!AER-DAT4.0\r\n", "AEDAT"),
        ("a.mat", b"MATLAB 5.0 MAT-file", "MATLAB"),
        ("a", b"Event Stream\x02\x00\x00", "Event Stream"),
        ("a.raw", b"% evt 2.1\n% end\n\x00", "Prophesee EVT2.1"),
        ("a.DAT", b"% Data file containing CD events.\n% Version 2\n\x0c\x08", "Prophesee DAT"),
        ("a.npz", b"PK\x03\x04", "NumPy"),
        ("a.zip", b"PK\x03\x04", None),
        ("a.db3", b"SQLite format 3\x00", "bag of ROS"),
        ("labels.sqlite", b"SQLite format 3\x00", None),
        ("notes.txt", b"t,x,y,p\n", None),
        ("a.csv", b"", None),
    ],
)
def test_lists_know_every_format_that_is_opened(tmp_path: Path, name: str, head: bytes, kind: str | None) -> None:
    path = tmp_path / name
    path.write_bytes(head)
    assert kind_of(path) == kind
