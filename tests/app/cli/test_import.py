"""`rallyscope import` from the outside: files, exit codes, one line for every mistake."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from app.cli import main
from core.recordings import open_recording


@pytest.fixture
def csv(tmp_path):
    """An event file: 3,000 events in 30 ms of an unnamed small camera."""
    path = tmp_path / "events.csv"
    rows = np.arange(3000)
    table = np.stack([7_000_000 + rows * 10, rows % 300, rows % 200, rows % 2], axis=1)
    np.savetxt(path, table, fmt="%d", delimiter=",", header="t,x,y,p", comments="")
    return path


def run(capsys, *words) -> tuple[int, str, str]:
    code = main([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


def test_one_source_becomes_a_recording(tmp_path, csv, capsys):
    code, out, err = run(capsys, "import", csv, tmp_path / "a.h5")
    assert (code, err) == (0, "")
    assert "a.h5: 0.030 s" in out
    assert "camera: 3,000 events" in out
    with open_recording(tmp_path / "a.h5") as recording:
        assert recording.cameras["camera"].event_count == 3000


def test_two_sources_with_names_offset_and_size_and_json(tmp_path, csv, capsys):
    code, out, _ = run(
        capsys, "import", csv, csv, tmp_path / "a.h5", "--names", "near,far", "--offset-us", "-500",
        "--width", "640", "--height", "480", "--json",
    )  # fmt: skip
    assert code == 0
    made = json.loads(out)
    assert made["events"] == {"near": 3000, "far": 3000}
    assert made["duration_us"] == 29_991 + 500
    with open_recording(tmp_path / "a.h5") as recording:
        assert str(recording.cameras["far"].sensor) == "640x480"
        assert recording.cameras["near"].slice(0, 501).t_us.tolist() == [500]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["{csv}"], "wrong number of files; expected SRC [SRC2 ...] DST.h5, got 1"),
        (["{csv}", "{csv}", "{csv}", "{out}"], "the names do not fit; expected 3 different ones"),
        (["missing.raw", "{out}"], "missing.raw: the file cannot be opened; got No such file or directory"),
        (["{csv}", "{out}", "--width", "640"], "--width and --height go together; give both"),
        (
            ["{csv}", "{out}", "--width", "0", "--height", "5"],
            "--width: expected whole numbers above 0 between",
        ),
        (["{csv}", "{out}", "--frames", "x"], "--frames, --frame-times and --exposure-us go together"),
        (["{csv}", "{out}", "--names", "a,b"], "the names do not fit; expected 1 different ones, got a,b"),
        (["{csv}", "{csv}"], "events.csv: the recording would replace its own source"),
        (["{csv}", "{csv}/a.h5"], "cannot make the folder"),
    ],
)
def test_mistakes_are_one_line_and_exit_code_2(tmp_path, csv, capsys, words, message):
    filled = [word.format(csv=csv, out=tmp_path / "a.h5", folder=tmp_path) for word in words]
    code, out, err = run(capsys, "import", *filled)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "a.h5").exists()


def test_an_existing_file_is_replaced_only_by_force(tmp_path, csv, capsys):
    target = tmp_path / "a.h5"
    target.write_text("precious")
    code, _, err = run(capsys, "import", csv, target)
    assert code == 2 and "the file exists; choose another name, or --force" in err
    assert target.read_text() == "precious"
    code, _, _ = run(capsys, "import", csv, target, "--force")
    assert code == 0
    with open_recording(target) as recording:
        assert recording.duration_us == 29_991


def test_force_with_a_source_that_cannot_be_read_keeps_the_old_file(tmp_path, capsys):
    target = tmp_path / "a.h5"
    target.write_text("precious")
    (tmp_path / "bad").write_text("no events at all")
    code, _, _ = run(capsys, "import", tmp_path / "bad", target, "--force")
    assert code == 2
    assert target.read_text() == "precious"


def test_control_c_ends_the_import_and_leaves_no_file(tmp_path):
    source = tmp_path / "big.csv"
    with source.open("w") as file:
        for block in range(12):
            rows = np.arange(100_000) + block * 100_000
            np.savetxt(file, np.stack([rows, rows % 300, rows % 200, rows % 2], axis=1), fmt="%d", delimiter=",")
    target = tmp_path / "a.h5"
    process = subprocess.Popen(
        [sys.executable, "-c", "import sys; from app.cli import main; sys.exit(main())", "import", source, target],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not target.exists() and process.poll() is None:
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130
    assert err.splitlines()[-1] == "rallyscope: stopped" and "Traceback" not in err
    assert not target.exists()
