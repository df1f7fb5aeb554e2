"""Every verb starts where Windows or macOS lack what Linux has, and the plain work is done there."""

import json
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from core.recordings import open_recording
from tests.other_systems import hidden_environment
from tests.waiting import PATIENCE_S

HELP = """
import argparse, importlib, sys
from app.cli.main import MODULES, VERBS, main
lines = [["--help"]]
for verb in VERBS:
    lines.append([verb, "--help"])
    module = importlib.import_module(f"app.cli.{MODULES.get(verb, verb)}")
    lines += [[verb, act, "--help"] for act in getattr(module, "ACTS", {})]
for line in lines:
    try:
        code = main(line)
    except SystemExit as end:
        code = end.code
    assert code == 0, line
import app.startup.startup, app.server  # what `serve` loads late
"""
WORK = """
import json, sys
from app.cli.main import main
for line in json.loads(sys.argv[1]):
    code = main(line)
    assert code == 0, line
"""
LABELS = "t_us,state,x_px,y_px,r_px\n10000,visible,20.0,15.0,4.0\n"
CAMERA = ["--camera", "left"]
SIMULATE = ["simulate", "--serves", "1", "--sensor", "48x32", "--seed", "1"]
TRAIN = ["train", "--agent", "landing-model", "--state-source", "truth"]
PLAIN = [
    [*SIMULATE, "--speed", "9", "--out", "one.h5"],
    [*SIMULATE, "--speed", "9", "--out", "one.h5", "--force"],
    [*SIMULATE, "--speeds", "8,9", "--out", "set", "--jobs", "2"],
    ["info", "one.h5"],
    ["detect", "one.h5", *CAMERA, "--out", "ball.csv"],
    ["track", "one.h5", "--out", "track.csv"],
    ["labels", "import", "labels.csv", "one.h5", *CAMERA, "--annotator", "anna", "--format", "csv"],
    ["labels", "export", "one.h5", *CAMERA, "--format", "csv", "--out", "csv"],
    ["labels", "score", "one.h5", *CAMERA],
    ["export", "one.h5", "--csv", "columns"],
    ["import", "cd.dat", "cd.h5"],
    [*TRAIN, "--speeds", "5", "--episodes", "8", "--out", "run"],
]
"""With locks, replaced files, a folder of recordings made by two processes, and a decoder in a process of its own."""
SYSTEMS = ("windows", "macos")


def run(system: str, folder: Path, *command: str) -> None:
    (folder / "like").mkdir(exist_ok=True)
    environment = hidden_environment(system, folder / "like")
    words = [sys.executable, "-c", *command]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, env=environment, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr[-3000:] or done.stdout[-3000:]


@pytest.mark.parametrize("system", SYSTEMS)
def test_what_is_hidden_is_hidden_from_our_code_alone(system: str, tmp_path: Path) -> None:
    asked = """
import multiprocessing, os, signal, subprocess, sys
from core import files
from core.files import usable_cores
assert hasattr(os, "pwrite") and hasattr(signal, "SIGKILL"), "this is nobody's code"
assert usable_cores() == os.cpu_count(), "it did not ask for the affinity"
assert files.POSIX is (sys.argv[1] == "macos") and (files.fcntl is None) is not files.POSIX
assert hasattr(files.os, "pwrite") is files.POSIX
from labels.database.connection import _read_mounts
assert _read_mounts() == "" and open("/proc/mounts").read()
"""
    run(system, tmp_path, asked, system)


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.gate
def test_every_verb_starts(system: str, tmp_path: Path) -> None:
    run(system, tmp_path, HELP)


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_plain_work_is_done(system: str, tmp_path: Path) -> None:
    (tmp_path / "labels.csv").write_text(LABELS)
    events = [struct.pack("<II", 1000 * number, (number % 32) | (number % 30) << 14 | 1 << 28) for number in range(50)]
    (tmp_path / "cd.dat").write_bytes(b"% Version 2\n% Height 48\n% Width 64\n\x0c\x08" + b"".join(events))
    run(system, tmp_path, WORK, json.dumps(PLAIN))
    with open_recording(tmp_path / "cd.h5") as recording:
        assert len(recording.cameras["camera"].slice(0, 50_000)) == 50
    assert not list(tmp_path.glob("**/.unfinished-*")), "nothing that was begun is left"
