"""`rallyscope record`: recordings in the place of cameras, through the driver's own packets, to a recording again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from core.cameras import save_calibration, stereo_preset
from core.devices import neuromorphic
from core.devices.models import DVXPLORER, EVK4
from core.events import Events, SensorSize
from core.recordings import RecordingWriter, open_recording
from tests.core.devices.replayed_hardware import Replayed, ReplayedLibrary
from tests.waiting import PATIENCE_S, eventually

STARTED = """
import sys
from pathlib import Path
from app.cli import main
from core.devices import neuromorphic
from tests.core.devices.replayed_hardware import Replayed, ReplayedLibrary
from core.recordings import open_recording
recording = open_recording(Path(sys.argv[1]))
library = ReplayedLibrary({
    str(k): Replayed(stream=stream, duration_us=recording.duration_us, ring=10**9)  # a slow machine loses nothing
    for k, stream in enumerate(recording.cameras.values())
})
neuromorphic.load_driver = lambda: library
sys.exit(main(sys.argv[2:]))
"""


@pytest.fixture(autouse=True)
def _own_signals():
    kept = {name: signal.getsignal(name) for name in (signal.SIGINT, signal.SIGTERM)}
    yield
    for name, handler in kept.items():
        signal.signal(name, handler)


@pytest.fixture
def plugged_in(serve_recording, monkeypatch):
    """Two cameras, 0 and 1, that see the recording."""
    with open_recording(serve_recording) as recording:
        duration_us = recording.duration_us
        seen = {
            str(k): Replayed(stream=stream, duration_us=duration_us, ring=10**9)  # a slow machine loses nothing
            for k, stream in enumerate(recording.cameras.values())
        }
        library = ReplayedLibrary(seen)
        monkeypatch.setattr(neuromorphic, "load_driver", lambda: library)
        yield library


def start(recording: Path, *words: str) -> subprocess.Popen:
    command = [sys.executable, "-c", STARTED, str(recording), "record", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for_bytes(path: Path, count: int, process: subprocess.Popen) -> None:
    def has_them() -> bool:
        assert process.poll() is None, process.stderr and process.stderr.read()
        return path.exists() and path.stat().st_size >= count

    eventually(has_them, f"{count:,} bytes in {path.name}")


@contextmanager
def ctrl_c_after(library: ReplayedLibrary, duration_us: int) -> Iterator[None]:
    """Ctrl-C for what runs meanwhile, once it listens to that and has read so much of every camera."""
    usual = signal.getsignal(signal.SIGINT)

    def has_all() -> bool:
        seen = [device.sent_us for device in library.opened]
        return len(seen) == len(library.cameras) and min(seen) > duration_us

    def interrupt() -> None:
        eventually(lambda: signal.getsignal(signal.SIGINT) is not usual and has_all(), "all packets to be read")
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    yield
    thread.join()


def assert_saw(path: Path, serve_recording: Path, *, all_of_it: bool = True) -> None:
    with open_recording(path) as found, open_recording(serve_recording) as known:
        zero_us = min(int(stream.slice(0, 10_000).t_us[0]) for stream in known.cameras.values())
        for name, stream in known.cameras.items():
            seen, saw = found.cameras[name].slice(0, 10**7), stream.slice(0, 10**7)
            count = len(saw) if all_of_it else len(seen)
            assert len(seen) == count > 10_000
            np.testing.assert_array_equal(seen.t_us + zero_us, saw.t_us[:count])
            np.testing.assert_array_equal(seen.x_px, saw.x_px[:count])


@pytest.mark.gate
def test_a_stereo_pair_is_recorded_with_its_calibration(plugged_in, serve_recording, tmp_path, capsys):
    out, cameras = tmp_path / "pair.h5", tmp_path / "cameras.toml"
    save_calibration(cameras, stereo_preset())
    words = ["--source", "camera:0,1", "--sync-cable", "--calibration", str(cameras), "--out", str(out)]
    with open_recording(serve_recording) as recording, ctrl_c_after(plugged_in, recording.duration_us):
        assert main(["record", *words, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["packets_dropped"] == {"left": 0, "right": 0} and report["path"] == str(out)
    assert [one.configuration.clock.name for one in plugged_in.opened] == ["EXTERNAL", "INTERNAL_WITH_OUTPUT_ENABLED"]
    assert_saw(out, serve_recording)
    with open_recording(out) as found:
        for name, camera in stereo_preset().items():
            np.testing.assert_allclose(found.cameras[name].calibration.T_world_camera, camera.T_world_camera)
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["cameras.toml", "pair.h5"], "no RAW files are left"


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_it_properly(serve_recording, tmp_path, stop):
    out = tmp_path / "pair.h5"
    process = start(serve_recording, "--source", "camera:0,1", "--sync-cable", "--out", str(out), "--keep-raw")
    wait_for_bytes(tmp_path / "pair.left.raw", 200_000, process)
    process.send_signal(stop)
    said, problems = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and "left:" in said and "Traceback" not in problems
    assert_saw(out, serve_recording, all_of_it=False)
    assert (tmp_path / "pair.left.raw").exists()


@pytest.mark.gate
def test_after_a_kill_import_makes_the_recording(serve_recording, tmp_path, capsys):
    out = tmp_path / "pair.h5"
    process = start(serve_recording, "--source", "camera:0,1", "--sync-cable", "--out", str(out))
    raw = [str(tmp_path / f"pair.{name}.raw") for name in ("left", "right")]
    for path in raw:
        wait_for_bytes(Path(path), 200_000, process)
    process.kill()
    process.wait(PATIENCE_S)
    assert not out.exists()
    assert main(["import", *raw, str(out)]) == 0
    assert_saw(out, serve_recording, all_of_it=False)


def test_a_full_disk_is_one_line_and_what_came_is_kept(serve_recording, tmp_path):
    """As far as a limit on the size of files is one: the same call fails, at any byte."""
    out = tmp_path / "pair.h5"
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))\n{STARTED}"
    words = [str(serve_recording), "record", "--source", "camera:0,1", "--sync-cable", "--out", str(out)]
    done = subprocess.run([sys.executable, "-c", limited, *words], capture_output=True, text=True, timeout=PATIENCE_S)
    said = done.stderr.strip().splitlines()
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert said[-1].startswith("rallyscope:") and "cannot write what the camera sends" in said[-1]
    assert "free some space" in said[-1] and "rallyscope import" in said[-2]
    assert not out.exists() and (tmp_path / "pair.left.raw").stat().st_size > 100_000
    assert main(["import", *map(str, (tmp_path / f"pair.{name}.raw" for name in ("left", "right"))), str(out)]) == 0
    assert_saw(out, serve_recording, all_of_it=False)


def test_cameras_that_send_no_evt3_are_recorded_by_blocks(serve_recording, tmp_path, monkeypatch, capsys):
    with open_recording(serve_recording) as recording:
        small = DVXPLORER.__class__(**{
            field: getattr(DVXPLORER, field) for field in DVXPLORER.__dataclass_fields__
        } | {"sensor": EVK4.sensor})  # fmt: skip
        monkeypatch.setitem(neuromorphic.MODELS, DVXPLORER.name, small)
        stream = next(iter(recording.cameras.values()))
        library = ReplayedLibrary({"7": Replayed(stream=stream, duration_us=10**8, model=small)})
        monkeypatch.setattr(neuromorphic, "load_driver", lambda: library)
        out = tmp_path / "one.h5"
        assert main(["record", "--source", "camera:7", "--out", str(out), "--seconds", "1.5"]) == 0
    with open_recording(out) as found:
        assert found.cameras["camera"].event_count > 1000


def test_a_replay_is_recorded_once_from_its_first_event_to_its_last(serve_recording, tmp_path, capsys):
    out = tmp_path / "again.h5"
    assert main(["record", "--source", f"replay:{serve_recording}@10", "--out", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    with open_recording(out) as found, open_recording(serve_recording) as known:
        assert 0 <= report["duration_us"] - known.duration_us < 10_000  # whole blocks
        for name, stream in known.cameras.items():
            seen, saw = found.cameras[name].slice(0, 10**8), stream.slice(0, 10**8)
            assert report["events"][name] == len(saw)
            for column in ("t_us", "x_px", "y_px", "on"):
                np.testing.assert_array_equal(getattr(seen, column), getattr(saw, column))


def test_a_replay_goes_round_if_that_is_asked_for(tmp_path, capsys):
    short, out = tmp_path / "short.h5", tmp_path / "again.h5"
    t = np.arange(500) * 200
    events = Events.from_columns(t, t % 61, t % 47, t % 3 == 0, SensorSize(64, 48))
    with RecordingWriter(short, {"camera": events.sensor}) as writer:
        writer.append("camera", events)
    words = ["--source", f"replay:{short}@20", "--loop", "--seconds", "1"]
    assert main(["record", *words, "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["events"]["camera"] > 2 * len(events)
    with open_recording(out) as recording:
        (stream,) = recording.cameras.values()
        for start_us in (0, 100_000):
            found = stream.slice(start_us, start_us + 100_000)
            np.testing.assert_array_equal(found.t_us - start_us, events.t_us)
            np.testing.assert_array_equal(found.x_px, events.x_px)


def test_cameras_are_listed(plugged_in, capsys):
    assert main(["record", "--list", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["cameras"]
    assert [row["serial"] for row in rows] == ["0", "1"] and "rate limit" in rows[0]["offers"]
    assert main(["record", "--list"]) == 0
    assert "Prophesee EVK4" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--source", "camera:"], "no camera is named.*0 .Prophesee EVK4., 1"),
        (["--source", "camera:0,0"], "not one or more different cameras"),
        (["--source", "camera:0,1,0"], "not one or more different cameras"),
        (["--source", "camera:0,1,2"], "no such camera"),
        (["--source", "camera:9"], "no such camera.*0 .Prophesee EVK4."),
        (["--source", "camera:0", "--sync-cable"], "a sync cable joins two cameras"),
        (["--source", "usb:0"], "not a source"),
        (["--source", "replay:none.h5"], "no such file to replay"),
        (["--source", "replay:none.h5", "--sync-cable"], "are of event cameras"),
        (["--source", "tcp://127.0.0.1:1", "--out", "a.h5", "--loop"], "--loop is for a replay"),
        ([], "nothing to record"),
    ],
)
def test_mistakes_are_one_line(plugged_in, tmp_path, capsys, words, line):
    import re

    assert main(["record", *words, *(["--out", str(tmp_path / "x.h5")] if words else [])]) == 2
    said = capsys.readouterr().err
    assert re.search(line, said) and len(said.strip().splitlines()) == 1
    assert not list(tmp_path.glob("*.raw"))


def test_without_the_driver_the_remedy_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, neuromorphic.LIBRARY, None)
    for words in (["record", "--list"], ["serve", "--source", "camera:1", "--data", str(tmp_path), "--port", "0"]):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert "pip install 'rallyscope[camera]'" in said and len(said.strip().splitlines()) == 1


def test_an_existing_recording_is_not_replaced(plugged_in, tmp_path, capsys):
    out = tmp_path / "old.h5"
    out.write_bytes(b"precious")
    assert main(["record", "--source", "camera:0", "--out", str(out), "--seconds", "1"]) == 2
    assert "the file exists" in capsys.readouterr().err and out.read_bytes() == b"precious"
