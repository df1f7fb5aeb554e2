"""`rallyscope serve --source camera:...` as a process, with recordings in the place of cameras."""

from __future__ import annotations

import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from app.cli import main
from app.cli.event_cameras import CameraArguments, read_camera_order
from core.cameras import save_calibration, stereo_preset
from core.events import SensorSize
from tests.app.cli.printed_address import address_in
from tests.waiting import PATIENCE_S

STARTED = """
import sys
from pathlib import Path
from app.cli import main
from app.cli.event_cameras import CameraArguments, read_camera_order
from core.devices import neuromorphic
from tests.core.devices.replayed_hardware import Replayed, ReplayedLibrary
from core.recordings import open_recording
recording = open_recording(Path(sys.argv[1]))
library = ReplayedLibrary({
    str(k): Replayed(stream=stream, duration_us=recording.duration_us)
    for k, stream in enumerate(recording.cameras.values())
})
neuromorphic.load_driver = lambda: library
code = main(sys.argv[2:])
assert all(device.closed for device in library.opened) and len(library.opened) == 2
sys.exit(code)
"""


def test_cameras_are_served_and_closed(serve_recording, tmp_path) -> None:
    cameras, log = tmp_path / "cameras.toml", tmp_path / "log"
    save_calibration(cameras, stereo_preset())
    words = ["serve", "--source", "camera:0,1", "--sync-cable", "--calibration", str(cameras)]
    places = ["--port", "0", "--data", str(tmp_path / "data")]
    with log.open("w") as out:
        command = [sys.executable, "-c", STARTED, str(serve_recording), *words, *places]
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
    try:
        address, browser = address_in(log, process), urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        with browser.open(address, timeout=PATIENCE_S) as page:
            assert b"<html" in page.read(2000).lower()
        with pytest.raises(urllib.error.HTTPError, match="401"):  # another user of this machine knows no token
            urllib.request.urlopen(address.partition("?")[0], timeout=PATIENCE_S)
    finally:
        process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 0, log.read_text()
    assert "Traceback" not in log.read_text()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--source", "live", "--sync-cable"], "are of event cameras"),
        (["--biases", "x.toml"], "are of event cameras"),
        (["--source", "camera:1,2", "--calibration", "ONE"], "the calibration is of other cameras"),
        (["--source", "camera:1", "--calibration", "STRANGE"], "not a camera name"),
        (["--source", "camera:1", "--biases", "NONE"], "cannot read the biases"),
    ],
)
def test_mistakes_are_one_line(tmp_path, capsys, words, line) -> None:
    one = tmp_path / "one.toml"
    strange, left = tmp_path / "strange.toml", stereo_preset("side", SensorSize(1280, 720))["left"]
    save_calibration(one, {"left": left})
    save_calibration(strange, {"../../left": left})
    files = {"ONE": str(one), "STRANGE": str(strange), "NONE": str(tmp_path / "none.toml")}
    assert main(["serve", *(files.get(word, word) for word in words), "--data", str(tmp_path), "--port", "0"]) == 2
    said = capsys.readouterr().err
    assert line in said and len(said.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("camera:A.1,B,C", ("A-1", "B", "C")),
        ("camera:A.1,A:1,B", ("A-1-1", "A-1-2", "B-3")),
        ("camera:A.1,A:1", ("left", "right")),
    ],
)
def test_every_camera_has_a_name_of_its_own_whatever_its_serial_number_holds(source, names) -> None:
    order = read_camera_order(source, CameraArguments(calibration=None, biases=None, sync_cable=False))
    assert order is not None and tuple(order.serials) == names
