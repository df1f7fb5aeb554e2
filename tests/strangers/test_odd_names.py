"""Names that are no text, terminals with few characters: each verb ends with 0, or with one line of what is wrong."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import pytest

from app.cli import main
from benchmarks.detector_training.run import training_folder
from core.devices.raw_recorder import raw_path
from core.files import LONGEST_NAME_BYTES, beside
from core.recordings import ImportOrder, import_recording, open_recording
from tests.app.shared.event_files import write_csv

ODD = "b\udcff\u4e2d\u00e9"
"""A byte that is no character, one of another script, and one of Latin-1."""
LABELS = "labels import @-labels.csv @.h5 --format csv --data @-data"
RUNS = {
    "info @.h5": 0,
    "import @.csv --check": 0,
    "import @.csv @-2.h5 --json": 0,
    "import @.csv @-3.h5 --names @": 2,
    "import @.csv @-3.h5 --calibration @": 2,
    LABELS: 0,
    f"{LABELS} --annotator @": 2,
    "detect @.h5 --out @-d.csv": 0,
    "predict @.csv --out @.json": 2,
    "export @.h5 --evt3 @-evt3": 0,
    "record --source replay:@.h5 --out @-r.h5": 0,
    "record --source @ --out q.h5": 2,
    "serve @.h5 --host @": 2,
    "evaluate @": 2,
    "@": 2,
    "--plugin @.py info @.h5": 2,
}
"""Command line, with @ for the odd name -> exit code."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording and labels of it, of odd names."""
    folder = tmp_path_factory.mktemp("odd")
    write_csv(folder / f"{ODD}.csv", 20)
    import_recording(ImportOrder([folder / f"{ODD}.csv"]), folder / f"{ODD}.h5")
    (folder / f"{ODD}-labels.csv").write_text("t_us,state,x_px,y_px,r_px\n2000,visible,5,5,3\n")
    return folder


def call(monkeypatch: pytest.MonkeyPatch, encoding: str, words: list[str]) -> tuple[int, str, str]:
    """Exit code, and what was printed on a terminal of that encoding."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict") for _ in range(2))
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", out)
        patch.setattr(sys, "stderr", err)
        code = main(words)
    for stream in (out, err):
        stream.seek(0)
    return code, out.read(), err.read()


@pytest.mark.parametrize("command", RUNS)
def test_names_that_are_no_text_are_taken_or_refused_in_one_line(command: str, folder: Path, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    code, _, error = call(monkeypatch, "ascii", command.replace("@", ODD).split(" "))
    assert code == RUNS[command] and "Traceback" not in error
    assert code == 0 or error.count("\n") == 1


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "cp437", "utf-8", "utf-16"])
def test_a_terminal_of_any_encoding_shows_what_a_recording_holds(encoding: str, folder: Path, monkeypatch) -> None:
    monkeypatch.chdir(folder)
    code, out, _ = call(monkeypatch, encoding, ["info", f"{ODD}.h5"])
    assert code == 0 and "microseconds are assumed" in out


@pytest.mark.parametrize(
    "command",
    [
        "import @ a.h5",
        "import @/bag b.h5",
        "info @/bag/bag.db3",
        "export @/in.h5 --rrd @/x.rrd",
        "export @/in.h5 --mcap @/x.mcap",
        "export @/in.h5 --rosbag @/again",
        "labels import @/yolo @/in.h5 --format yolo --annotator a --data @/data --frame-times times.csv",
        "detect @/in.h5 --out @/d.csv",
    ],
)
def test_folders_whose_names_are_no_text_are_read_and_written(command: str, tmp_path: Path, monkeypatch) -> None:
    """Rerun and the library of ROS bags take no path that is not UTF-8."""
    monkeypatch.chdir(tmp_path)
    labels = tmp_path / ODD / "yolo" / "labels"
    labels.mkdir(parents=True)
    (labels.parent / "classes.txt").write_text("ball\n")
    (labels / "frame_000001.txt").write_text("0 0.5 0.5 0.1 0.1\n")
    (tmp_path / "times.csv").write_text("t_us\n0\n2000\n")
    write_csv(tmp_path / ODD / "left.csv", 20)
    import_recording(ImportOrder([tmp_path / ODD / "left.csv"]), tmp_path / "in.h5")
    assert main(["export", "in.h5", "--rosbag", "bag"]) == 0
    if "bag" in command:
        (tmp_path / "bag").rename(tmp_path / ODD / "bag")
    (tmp_path / "in.h5").rename(tmp_path / ODD / "in.h5" if "in.h5" in command else tmp_path / "other.h5")
    code, _, error = call(monkeypatch, "utf-8", command.replace("@", ODD).split(" "))
    assert code == 0, error


@pytest.mark.parametrize("letter", ["e", "\u00e4", "\u7403"])
def test_a_recording_has_the_longest_name_that_there_is(letter: str, folder: Path, tmp_path: Path) -> None:
    """bmad-code-org/bmad-loop#595: the name of the unfinished file was longer than any name may be."""
    free = LONGEST_NAME_BYTES - len(".h5")
    out = tmp_path / f"{letter * (free // len(letter.encode()))}{'-' * (free % len(letter.encode()))}.h5"
    import_recording(ImportOrder([folder / f"{ODD}.csv"]), out)
    with open_recording(out) as recording:
        assert len(recording.cameras["camera"].slice(0, 10**9)) > 0
    assert [path.name for path in tmp_path.iterdir()] == [out.name]


def test_a_name_beside_another_is_shortened_only_where_it_must_be(tmp_path: Path) -> None:
    assert beside(tmp_path / "a.h5", ".", ".part") == tmp_path / ".a.h5.part"
    whole = tmp_path / ("e" * 248 + ".h5")
    assert beside(whole, "", ".log") == tmp_path / ("e" * 248 + ".h5.log")
    names = [beside(tmp_path / f"{chr(0x7403) * 83}{k}.h5", ".", ".part").name for k in (1, 2)]
    assert len(set(names)) == 2 and all(len(name.encode()) <= LONGEST_NAME_BYTES for name in names)
    assert all(name.startswith("." + chr(0x7403) * 70) and name.endswith(".part") for name in names)
    longest = tmp_path / ("e" * (LONGEST_NAME_BYTES - len(".h5")) + ".h5")
    raw_path(longest, "camera").touch()
    training_folder(longest).mkdir()
