"""Sources that are pipes, streams that are missing or full, folders with files named like modules: the work is done."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import h5py
import numpy as np
import pytest

from app.cli.main import main
from core.recordings import ImportOrder, import_recording, open_recording

ROWS = "t_us,x,y,p\n" + "".join(f"{1000 * k},{k % 640},{k % 480},{k % 2}\n" for k in range(600))
PROGRAM = """
import multiprocessing, os, sys
from app.cli import main
if __name__ == "__main__":
    code = main()
    child = multiprocessing.get_context("spawn").Process(target=os.getpid)
    child.start()
    child.join()
    sys.exit(code or child.exitcode)
"""
"""As the console script: the folder of the program is on the import path, not the working folder."""
PLANTED = ("rerun", "app", "core", "labels", "numpy", "h5py", "json", "struct", "pickle", "multiprocessing", "random")


@pytest.fixture
def program(tmp_path: Path) -> list[str]:
    """The command of a program that lies in a folder of its own."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "rally.py").write_text(PROGRAM)
    return [sys.executable, str(tmp_path / "bin" / "rally.py")]


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """600 events."""
    (tmp_path / "a.csv").write_text(ROWS)
    return tmp_path / "a.csv"


def events_in(path: Path) -> int:
    with h5py.File(path) as file:
        return len(file["cameras/camera/events/t"])  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("closed", "code"),
    [
        ("2>&-", 0),
        (">&-", 0),
        ("<&- >&- 2>&-", 0),
        ("> /dev/full", 0),
        ("> /dev/full 2>&1", 0),
        ("--json > /dev/full", 2),
    ],
)
def test_an_import_is_done_whatever_the_standard_streams_are(
    closed: str, code: int, program: list[str], table: Path, tmp_path: Path
) -> None:
    words = " ".join([*program, "import", str(table), str(tmp_path / "o.h5"), closed])
    done = subprocess.run(["sh", "-c", words], capture_output=True, text=True, check=False)
    assert done.returncode == code and events_in(tmp_path / "o.h5") == 600
    assert "Traceback" not in done.stderr
    if closed.endswith("/dev/full"):
        assert "standard output cannot be written" in done.stderr


def test_what_is_printed_and_lost_is_no_success(program: list[str], table: Path) -> None:
    words = " ".join([*program, "info", str(table), "> /dev/full"])
    done = subprocess.run(["sh", "-c", words], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "No space left" in done.stderr and "bug" not in done.stderr


def test_nothing_in_the_working_folder_is_imported_by_any_process(
    program: list[str], table: Path, tmp_path: Path
) -> None:
    import_recording(ImportOrder([table]), tmp_path / "a.h5")
    planted = tmp_path / "planted"
    planted.mkdir()
    for name in PLANTED:
        (planted / f"{name}.py").write_text(f"open(__file__ + '.ran', 'w')\nraise SystemExit('{name}')\n")
    command = [*program, "export", str(tmp_path / "a.h5"), "--rrd", str(tmp_path / "o.rrd")]
    done = subprocess.run(command, cwd=planted, capture_output=True, text=True, check=False)
    assert (done.returncode, [file.name for file in planted.glob("*.ran")]) == (0, []), done.stderr
    assert (tmp_path / "o.rrd").stat().st_size > 1000


def test_a_pipe_is_a_source_like_a_file(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_text, args=(ROWS,))
    writer.start()
    with open_recording(pipe) as recording:
        events = recording.cameras["camera"].slice(0, 600_000)
    writer.join()
    np.testing.assert_array_equal(events.t_us, 1000 * np.arange(600))


def test_the_wait_for_a_pipe_that_nobody_writes_to_is_told_and_cancelled(tmp_path: Path, caplog, monkeypatch) -> None:
    monkeypatch.setattr("core.recordings.sources.piped_sources._QUIET_S", 0.05)
    os.mkfifo(tmp_path / "pipe")
    looks = iter(range(5))
    assert (
        import_recording(
            ImportOrder([tmp_path / "pipe"]), tmp_path / "o.h5", cancelled=lambda: next(looks, None) is None
        )
        is None
    )
    assert "is a pipe: it is read until who writes to it ends" in caplog.text
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


def test_a_device_is_refused_as_one(tmp_path: Path, capsys) -> None:
    assert main(["import", "/dev/zero", str(tmp_path / "o.h5")]) == 2
    assert "not a file; got a device" in capsys.readouterr().err


@pytest.mark.parametrize("place", [0, 1, 2])
def test_options_stand_anywhere_between_the_files(place: int, table: Path, tmp_path: Path) -> None:
    words = [str(table), str(tmp_path / "o.h5")]
    words[place:place] = ["--width", "640", "--height", "480"]
    assert main(["import", *words]) == 0
    assert events_in(tmp_path / "o.h5") == 600


def test_the_names_of_options_that_nobody_knows_are_still_refused(table: Path, tmp_path: Path, capsys) -> None:
    assert main(["import", str(table), "--wide", "640", str(tmp_path / "o.h5")]) == 2
    assert "--wide" in capsys.readouterr().err


def test_one_file_for_two_cameras_is_refused(table: Path, tmp_path: Path, capsys) -> None:
    (tmp_path / "b.csv").symlink_to(table)
    assert main(["import", str(table), str(tmp_path / "b.csv"), str(tmp_path / "o.h5")]) == 2
    assert "the same file is given twice" in capsys.readouterr().err
