"""Every verb starts where Windows or macOS lack what Linux has, and the plain work is done there."""

import ast
import json
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from core.recordings import open_recording
from tests.other_systems import hidden_environment
from tests.sources import SOURCES, name_of, tree_of
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
from labels.database.file_system import _read_mounts
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


MODE = re.compile(r"[rwxa][bt+]{0,2}")
OTHERS = ("_writer", "arguments", "av", "layer", "library", "tarfile", "uploads", "webbrowser", "zipfile")
"""Whose `open` is of no text file."""


def called_name(call: ast.Call) -> str:
    """The last name of what is called."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def opens_text_without_encoding(call: ast.Call) -> bool:
    """Whether a call opens, reads or writes text in the encoding of whichever system it runs on."""
    function, name = call.func, called_name(call)
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    if "encoding" in given:
        return False
    if isinstance(function, ast.Attribute) and name in ("read_text", "write_text"):
        return len(call.args) < (1 if name == "read_text" else 2)
    if {"text", "universal_newlines"} & set(given):
        return name in ("run", "Popen", "check_output", "call", "check_call")
    if name not in ("open", "fdopen"):
        return False
    constants = [node.value for node in (*call.args, given.get("mode")) if isinstance(node, ast.Constant)]
    modes = [value for value in constants if isinstance(value, str) and MODE.fullmatch(value)]
    owner = function.value if isinstance(function, ast.Attribute) else None
    if (owner.attr if isinstance(owner, ast.Attribute) else getattr(owner, "id", "")) in OTHERS:
        return False
    if modes or owner is None:
        return not any("b" in mode for mode in modes)
    return not call.args and not given


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("open(path)", True),
        ("path.open()", True),
        ("path.open('w')", True),
        ("path.read_text()", True),
        ("path.write_text(text)", True),
        ("subprocess.run(words, text=True)", True),
        ("open(path, 'rb')", False),
        ("path.open('r+b')", False),
        ("path.read_text('utf-8')", False),
        ("path.open('w', encoding='utf-8')", False),
        ("layer.open()", False),
    ],
)
def test_the_rule_of_encodings_sees_what_it_is_to_see(text: str, wrong: bool) -> None:
    assert opens_text_without_encoding(ast.parse(text, mode="eval").body) is wrong  # type: ignore[arg-type]


def test_no_text_depends_on_the_encoding_of_a_system_and_no_process_is_forked() -> None:
    calls = [(path, node) for path in SOURCES for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
    found = [f"{name_of(path)}:{call.lineno}" for path, call in calls if opens_text_without_encoding(call)]
    assert not found
    # Windows opens no NamedTemporaryFile a second time, and a fork copies locks that other threads hold
    forbidden = ("NamedTemporaryFile", "fork", "Pool", "Process")
    named = [(f"{name_of(path)}:{call.lineno}", call, called_name(call)) for path, call in calls]
    assert not [place for place, _, name in named if name in forbidden]
    pools = {place: call for place, call, name in named if name == "ProcessPoolExecutor"}
    contexts = [ast.unparse(call) for _, call, name in named if name == "get_context"]
    assert pools and all("mp_context" in [word.arg for word in call.keywords] for call in pools.values())
    assert contexts and all("'spawn'" in context for context in contexts)
