"""`rallyscope simulate` with lists: a folder of recordings that survives being killed."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from app.cli import main
from core.data_sets import CARD, MANIFEST
from tests.processes import is_alive
from tests.waiting import PATIENCE_S, eventually

SMALL = ("--sensor", "48x32", "--serves", "1")


def simulate(out: Path, *more: str) -> int:
    return main(["simulate", "--out", str(out), *more])


def children_of(process: int) -> set[int]:
    """All processes that it started, and those that they started."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
    found: set[int] = set()
    while new := {child for child, parent in parents.items() if parent in {process, *found}} - found:
        found |= new
    return found


def test_lists_make_a_folder_of_recordings_with_a_card_and_a_second_run_finds_them(tmp_path: Path, capsys) -> None:
    out = tmp_path / "sets" / "first"
    arguments = (*SMALL, "--speeds", "8,9", "--scenes", "dark", "--cameras", "behind", "--no-robot", "--jobs", "1")
    assert simulate(out, *arguments, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    names = ["dark-8mps-behind-1", "dark-9mps-behind-1"]
    assert said["made"] == names and said["kept"] == [] and said["folder"] == str(out)
    assert said["total"] == json.loads((out / MANIFEST).read_text())["total"] and said["total"]["recordings"] == 2
    assert all((out / f"{name}.h5").exists() for name in names) and "behind" in (out / CARD).read_text()
    assert simulate(out, *arguments) == 0
    text = capsys.readouterr().out
    assert "0 recordings made, 2 were there" in text and str(out / CARD) in text
    assert simulate(out, *arguments, "--noise-hz", "3") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "another noise_hz; expected 3.0, got 0.1" in error and "--force" in error


def test_a_preset_takes_pictures_of_its_own(tmp_path: Path, capsys, monkeypatch) -> None:
    seen = []
    monkeypatch.setattr("app.cli.simulate.run_data_set", lambda plan, *_, **__: seen.append(plan) or 1 / 0)
    for more in ((), ("--exposure-us", "2000"), ("--frames-hz", "50")):
        assert simulate(tmp_path / "a", "--preset", "paper7", *more) == 1
    frames = [plan.recordings[0].making.frames for plan in seen]
    assert [(each.rate_hz, each.exposure_us) for each in frames] == [(30.0, 5000), (30.0, 2000), (50.0, 5000)]
    assert len(seen[0].recordings) == 7
    capsys.readouterr()


MISTAKES = [
    (("--speeds", "5", "--speed", "5"), "--speed: is of a single recording"),
    (("--scenes", "ball", "--scene", "ball"), "--scene: is of a single recording"),
    (("--speeds", "5,fast"), "numbers between commas"),
    (("--speeds", "5,2"), "3 to 9"),
    (("--scenes", "ball,moon"), "no scene 'moon'"),
    (("--scenes", "ball,"), "names between commas"),
    (("--scenes", "ball", "--cameras", "side,moon"), "--cameras: no such cameras for a data set"),
    (("--jobs", "2"), "--jobs: goes with --speeds"),
    (("--recordings-per", "2"), "--recordings-per: goes with --speeds"),
    (("--speeds", "5", "--jobs", "0"), "--jobs"),
    (("--preset", "paper8"), "one of paper7"),
    (("--preset", "paper7", "--speeds", "5"), "--speeds: is what a preset says itself"),
    (("--preset", "paper7", "--robot"), "--robot: is what a preset says itself"),
    (("--exposure-us", "100"), "--frames-hz"),
    (("--frames-hz", "100", "--exposure-us", "20000"), "at most 10000 us at 100 Hz"),
    (("--scene", "rally", "--robot"), "two players have the table"),
    (("--scenes", "rally", "--physics", "real"), "without air"),
]


@pytest.mark.parametrize(("arguments", "says"), MISTAKES)
def test_a_mistake_is_one_line_exit_2_and_no_folder(
    tmp_path: Path, capsys, arguments: tuple[str, ...], says: str
) -> None:
    assert simulate(tmp_path / "a", *arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1 and says in captured.err and captured.out == ""
    assert list(tmp_path.iterdir()) == []


def test_a_folder_cannot_have_the_name_of_a_file(tmp_path: Path, capsys) -> None:
    out = tmp_path / "a.h5"
    out.write_bytes(b"precious")
    assert simulate(out, "--speeds", "5", "--force") == 2
    assert "a data set is a folder" in capsys.readouterr().err and out.read_bytes() == b"precious"


@pytest.mark.parametrize(
    ("how", "code"), [(signal.SIGKILL, -signal.SIGKILL), (signal.SIGINT, 130), (signal.SIGTERM, -signal.SIGTERM)]
)
def test_an_end_by_force_leaves_no_half_recording_and_no_process_and_the_next_run_goes_on(
    tmp_path: Path, how: signal.Signals, code: int
) -> None:
    out = tmp_path / "set"
    arguments = ["--speeds", "7,8,9", "--serves", "8", "--sensor", "320x240", "--jobs", "2", "--recordings-per", "2"]
    command = [sys.executable, "-m", "app.cli", "simulate", "--out", str(out), *arguments]
    run = subprocess.Popen(command, stderr=subprocess.PIPE, start_new_session=True)
    try:
        eventually(lambda: len(list(out.glob(".*.partial.h5"))) == 2, "two that are being made")
        helpers = children_of(run.pid)
        assert len(helpers) >= 2
        if how is signal.SIGINT:
            workers = [one for one in helpers if b"spawn_main" in Path(f"/proc/{one}/cmdline").read_bytes()]
            os.kill(workers[0], signal.SIGSTOP)  # one hangs: it hears nothing any more
            os.killpg(run.pid, how)  # Ctrl-C reaches the whole group
        else:
            run.send_signal(how)
        _, error = run.communicate(timeout=PATIENCE_S)
        assert run.returncode == code
        eventually(lambda: not any(is_alive(helper) for helper in helpers), "what it started to end, too")
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
    if how is signal.SIGINT:
        assert error.splitlines()[-1] == b"rallyscope: stopped" and b"Traceback" not in error
        assert not list(out.glob(".*.partial.h5*")), "nothing is left behind"
    for path in out.glob("[!.]*.h5"):
        with h5py.File(path) as file:  # whole, or not there
            assert int(file.attrs["duration_us"]) > 0  # pyright: ignore[reportArgumentType]
    assert simulate(out, "--speeds", "9", *SMALL, "--jobs", "1", "--no-robot", "--force") == 0
    assert not list(out.glob(".*.partial.h5*")), "the next run takes leftovers away"
    assert (out / "ball-9mps-side-1.h5").exists()
