"""A small disk of the tests that is really full: one clear line, the old file stays, and nothing unfinished is left."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import PATIENCE_S

FILLS = """
import os, shutil, sys
from pathlib import Path
import numpy as np
from app.cli.main import main
from app.shared.workspace import Workspace
from core.detection import DetectorConfig
from core.detection.saved import SavedDetector
from core.errors import RallyscopeError
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from labels.model import Label, LabelState
from labels.store import LabelStore
disk, events = Path(sys.argv[1]), Path(sys.argv[2])
workspace = Workspace(disk)
kept = workspace.keep_config("mine", SavedDetector("auto", DetectorConfig()))
done = 0
with LabelStore.open(disk / "labels", "u", "left", "anna") as store:
    store.put(Label(t_us=0, state=LabelState.NO_BALL))
    sensor = SensorSize(640, 480)
    rng = np.random.default_rng(1)
    try:
        with RecordingWriter(disk / "a.h5", {"left": sensor}) as writer:
            while True:
                t = np.arange(done, done + 100_000)
                columns = (rng.integers(0, size, len(t)) for size in (640, 480))
                writer.append("left", Events.from_columns(t, *columns, t % 3 == 0, sensor))
                writer.flush()
                done += len(t)
    except RallyscopeError as error:
        print("recording", error, flush=True)
    (disk / "filler").write_bytes(b"")
    with open(disk / "filler", "r+b", buffering=0) as filler:
        try:
            while filler.write(bytes(4096)):
                pass
        except OSError:
            pass
    try:
        for number in range(1, 3000):
            store.put(Label(t_us=1000 * number, state=LabelState.NO_BALL))
    except RallyscopeError as error:
        print("labels", number, error, flush=True)
try:
    workspace.keep_config("other", SavedDetector("auto", DetectorConfig()))
except RallyscopeError as error:
    print("config", error, flush=True)
print("import", main(["import", str(events), str(disk / "b.h5")]), flush=True)
print("left", sorted(path.name for path in disk.rglob("*") if path.name.startswith(".unfinished")), flush=True)
os.unlink(disk / "filler")
try:
    open_recording(disk / "a.h5")
except RallyscopeError as error:
    print("finishing", error, flush=True)
moved = Path(shutil.copy(disk / "a.h5", events.parent / "moved.h5"))  # where there is room
with open_recording(moved) as recording:
    print("events", recording.cameras["left"].event_count >= done > 0, flush=True)
with LabelStore.open(disk / "labels", "u", "left", "anna") as store:
    print("labelled", len(store.labels()), flush=True)
print("configs", workspace.config_names(), kept.stat().st_size > 0, flush=True)
"""
MOUNTED = 'mount -t tmpfs -o size=12m tmpfs "$1" || exit 77; shift; exec "$@"'


@pytest.mark.gate
def test_a_disk_that_is_really_full_loses_nothing_and_says_so_in_one_line(tmp_path: Path) -> None:
    if shutil.which("unshare") is None:
        pytest.skip("no unshare here: a disk of one's own cannot be mounted")
    disk, script, events = tmp_path / "disk", tmp_path / "fills.py", tmp_path / "events.csv"
    disk.mkdir()
    script.write_text(FILLS)
    events.write_text("t,x,y,p\n" + "".join(f"{k},{k % 640},{k % 480},{k % 2}\n" for k in range(5000)))
    command = [
        "unshare",
        "-m",
        "sh",
        "-c",
        MOUNTED,
        "sh",
        str(disk),
        sys.executable,
        str(script),
        str(disk),
        str(events),
    ]
    environment = os.environ | {"PYTHONPATH": os.getcwd()}
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S, env=environment)
    if ended.returncode == 77 or "unshare" in ended.stderr:
        pytest.skip(f"mounting is not allowed here: {ended.stderr.strip()[:200]}")
    assert ended.returncode == 0 and "Traceback" not in ended.stderr, ended.stderr
    said = dict(line.split(" ", 1) for line in ended.stdout.splitlines() if " " in line)
    assert "No space left" in said["recording"] and "free some space" in said["recording"], said
    last, line = said["labels"].split(" ", 1)
    assert "make room" in line, said
    assert "nothing is lost" in said["finishing"], said
    assert "free some space" in said["config"] and said["import"] == "2" and said["left"] == "[]", said
    assert said["events"] == "True" and said["labelled"] == last and said["configs"] == "('mine',) True", said
    told = [line for line in ended.stderr.splitlines() if line.startswith("rallyscope: ")]
    assert len(told) == 1 and "space" in told[0], ended.stderr
