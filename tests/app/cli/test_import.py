"""`rallyscope import` from the outside: files, exit codes, one line for every mistake."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest

from app.cli import main
from core.recordings import open_recording
from tests.waiting import eventually


@pytest.fixture
def csv(tmp_path):
    """An event file: 3,000 events in 30 ms of an unnamed small camera."""
    path = tmp_path / "events.csv"
    rows = np.arange(3000)
    table = np.stack([7_000_000 + rows * 10, rows % 300, rows % 200, rows % 2], axis=1)
    np.savetxt(path, table, fmt="%d", delimiter=",", header="t,x,y,p", comments="")
    return path


@pytest.fixture
def others(tmp_path_factory, csv):
    """Two more files of that name with the same events, as of other cameras, in folders of their own."""
    paths = [tmp_path_factory.mktemp(name) / csv.name for name in ("second", "third")]
    for path in paths:
        shutil.copy(csv, path)
    return paths


def run(capsys, *words) -> tuple[int, str, str]:
    code = main([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.mark.gate
def test_one_source_becomes_a_recording(tmp_path, csv, capsys):
    code, out, err = run(capsys, "import", csv, tmp_path / "a.h5")
    assert (code, err) == (0, "")
    assert "a.h5: 0.030 s" in out
    assert "camera: 3,000 events" in out
    with open_recording(tmp_path / "a.h5") as recording:
        assert recording.cameras["camera"].event_count == 3000


def test_two_sources_with_names_offset_and_size_and_json(tmp_path, csv, others, capsys):
    code, out, _ = run(
        capsys, "import", csv, others[0], tmp_path / "a.h5", "--names", "near,far", "--offset-us", "-500",
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
        (
            ["{csv}", "{second}", "{third}", "{out}", "--names", "a,b,b"],
            "the names do not fit; expected 3 different ones",
        ),
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
def test_mistakes_are_one_line_and_exit_code_2(tmp_path, csv, others, capsys, words, message):
    filled = [
        word.format(csv=csv, second=others[0], third=others[1], out=tmp_path / "a.h5", folder=tmp_path)
        for word in words
    ]
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


HELD_AFTER_A_BLOCK = """
import sys, threading
from pathlib import Path
from app.cli import main
from core.recordings import RecordingWriter

append = RecordingWriter.append

def append_and_wait(writer, *block):
    append(writer, *block)
    Path("held").touch()
    while not threading.Event().wait(0.1):  # a signal that comes just before a wait does not end it
        pass

RecordingWriter.append = append_and_wait
sys.exit(main())
"""
"""An import that is never over by itself, so that Ctrl-C comes in the middle of it."""


@pytest.mark.gate
def test_control_c_ends_the_import_and_leaves_no_file(tmp_path, csv):
    target = tmp_path / "a.h5"
    process = subprocess.Popen(
        [sys.executable, "-c", HELD_AFTER_A_BLOCK, "import", csv, target],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    )
    # Not earlier: where Python runs a destructor or a callback of a library, it reports an interrupt and goes on.
    eventually(lambda: (tmp_path / "held").exists() or process.poll() is not None, "the first block")
    os.kill(process.pid, signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130
    assert err.splitlines()[-1] == "rallyscope: stopped" and "Traceback" not in err
    assert not target.exists()


CAMERA_KEYS = {
    "name", "file", "format", "width_px", "height_px", "sensor_from", "time_unit", "time_unit_from", "polarity",
    "polarity_from", "events", "on_events", "off_events", "first_us", "last_us", "triggers", "pictures",
    "calibration_from", "left_out", "changed", "assumed",
}  # fmt: skip


def test_a_check_says_what_the_file_holds_and_writes_nothing(tmp_path, csv, capsys):
    code, out, err = run(capsys, "import", csv, "--check")
    assert (code, err) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["events.csv"]
    for line in (
        "format       text",
        "sensor       304x240, assumed",
        "time unit    microseconds, assumed",
        "polarity     0 = OFF, 1 = ON, from the file",
        "events       3,000: 1,500 ON, 1,500 OFF",
        "first, last  7,000,000 us to 7,029,990 us on its own clock",
        "left out     nothing",
        "corrected    nothing",
    ):
        assert f"  {line}\n" in out
    assert "assumed:     events.csv does not name its sensor size; 304x240 is assumed from the events.\n" in out
    assert out.endswith("Nothing was written.\n")


def test_the_json_of_a_check_has_stable_keys_and_the_figures_of_the_import(tmp_path, csv, others, capsys):
    options = ("--width", "640", "--height", "480", "--time-unit", "us", "--json")
    code, out, _ = run(capsys, "import", csv, tmp_path / "a.h5", "--check", *options)
    assert code == 0 and not (tmp_path / "a.h5").exists()
    found = json.loads(out)
    assert set(found) == {"duration_us", "notes", "cameras", "assumed"}
    assert all(set(camera) == CAMERA_KEYS for camera in found["cameras"])
    code, out, _ = run(capsys, "import", csv, tmp_path / "a.h5", *options)
    made = json.loads(out)
    assert code == 0 and {name: made[name] for name in found} == found
    assert set(made) - set(found) == {"path", "events", "triggers"}
    assert made["events"] == {"camera": found["cameras"][0]["events"]}
    code, out, _ = run(capsys, "import", csv, others[0], tmp_path / "a.h5", "--check", "--names", "near,far", *options)
    assert code == 0  # a recording that is there already can only be the result
    assert [camera["name"] for camera in json.loads(out)["cameras"]] == ["near", "far"]


def test_each_source_may_have_its_own_unit_of_time(tmp_path, csv, others, capsys):
    """It could be stated for all of them only: a pair in us and ns had no way in but by new headings."""
    table = np.loadtxt(csv, delimiter=",", skiprows=1)
    np.savetxt(others[0], table * (1000, 1, 1, 1), fmt="%d", delimiter=",", header="t,x,y,p", comments="")
    words = ("import", csv, others[0], tmp_path / "a.h5")
    assert run(capsys, *words, "--time-unit", "us,ns")[0] == 0
    with open_recording(tmp_path / "a.h5") as recording:
        times = [camera.slice(0, 10**9).t_us for camera in recording.cameras.values()]
    np.testing.assert_array_equal(times, [10 * np.arange(3000)] * 2)
    _, _, err = run(capsys, *words[:-1], "--check", "--time-unit", "us,ns,s")
    assert "not a unit of time for each source; expected 2, got us,ns,s; see --time-unit" in err
    _, _, err = run(capsys, *words[:-1], "--check", "--time-unit", "us,h")
    assert "expected units of time (ns, us, ms, s) between commas, got 'us,h'" in err
    assert "or --time-unit with one for each source" in run(capsys, *words[:-1], "--check")[2]


def test_what_an_import_assumes_is_printed_and_listed_by_info(tmp_path, csv, capsys):
    code, found, _ = run(capsys, "import", csv, "--check", "--json")
    code, out, _ = run(capsys, "import", csv, tmp_path / "a.h5")
    _, info, _ = run(capsys, "info", tmp_path / "a.h5")
    assumed = json.loads(found)["assumed"]
    assert code == 0 and len(assumed) == 2
    for line in assumed:
        assert f"  {line}\n" in out and f"  note: {line}\n" in info


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["missing.raw", "--check"], "missing.raw: the file cannot be opened"),
        (["{csv}", "missing.raw", "--check"], "missing.raw: the file cannot be opened"),
        (
            ["{csv}", "{second}", "{third}", "--check", "--names", "a,b"],
            "the names do not fit; expected 3 different ones",
        ),
        (["{csv}", "--check", "--width", "30", "--height", "20"], "expected a sensor of at least 300x200"),
        (["{csv}", "--check", "--polarity", "1=on,2=off"], "which polarity is ON cannot be told"),
    ],
)
def test_a_check_refuses_what_the_import_would_refuse(tmp_path, csv, others, capsys, words, message):
    code, out, err = run(capsys, "import", *[word.format(csv=csv, second=others[0], third=others[1]) for word in words])
    assert (code, out) == (2, "")
    assert message in err and err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["events.csv"]


@pytest.mark.parametrize(("encoding", "form"), [("ascii", []), ("latin-1", ["--json"])])
def test_a_check_works_on_any_terminal_and_for_any_file_name(tmp_path, csv, encoding, form):
    name = os.fsencode(tmp_path) + b"/\xff\xe9ve\xcc\x81n\n\xe2\x82\xac.csv"
    os.rename(csv, name)
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0", "LC_ALL": "C"}
    words = [sys.executable, "-m", "app.cli", "import", name, "--check", *form]
    done = subprocess.run(words, capture_output=True, env=environment, check=False)
    assert (done.returncode, _but_progress(done.stderr)) == (0, [])
    said = done.stdout.decode(encoding)
    if form:
        assert json.loads(said)["cameras"][0]["events"] == 3000
    else:
        assert "  events       3,000: 1,500 ON, 1,500 OFF" in said and said.count("\n") == 14
    target = os.fsencode(tmp_path) + b"/\xff.h5"
    done = subprocess.run([*words[:5], target, *form], capture_output=True, env=environment, check=False)
    assert (done.returncode, _but_progress(done.stderr)) == (0, []) and os.path.exists(target)
    done = subprocess.run([*words[:3], "info", target], capture_output=True, env=environment, check=False)
    assert done.returncode == 0 and b"304x240 is assumed from the events" in done.stdout


def _but_progress(stderr: bytes) -> list[bytes]:
    """Lines of a child without those of its progress, which come if the machine is slow."""
    return [line for line in stderr.splitlines() if not line.endswith((b" so far", b" left"))]
