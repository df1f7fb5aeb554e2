"""`rallyscope serve` as a process, without a browser."""

import json
import shutil
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from app.cli import main, serve
from app.cli.arguments import Parser, add_arguments, read_arguments
from app.cli.replay import read_replay
from core.physics.config import physics_profile
from tests.app.cli.printed_address import address_in
from tests.processes import is_alive
from tests.waiting import PATIENCE_S, eventually

SERVE = [sys.executable, "-c", "import sys; from app.cli import main; sys.exit(main(sys.argv[1:]))", "serve"]


def asked(*words: str) -> serve.ServeArguments:
    parser = Parser()
    add_arguments(parser, serve.ServeArguments)
    return read_arguments(serve.ServeArguments, parser.parse_args(words))


def start(arguments: list[str], log: Path) -> tuple[subprocess.Popen, str]:
    """The running process and the address that it printed."""
    with log.open("w") as out:
        process = subprocess.Popen([*SERVE, *arguments], stdout=out, stderr=subprocess.STDOUT)
    try:
        return process, address_in(log, process)
    except AssertionError:
        process.kill()
        raise


@pytest.mark.parametrize("stop", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.gate
def test_it_serves_a_page_and_ends_calmly(serve_recording, tmp_path, stop) -> None:
    arguments = [str(serve_recording), "--port", "0", "--data", str(tmp_path / "data")]
    process, address = start(arguments, tmp_path / "log")
    try:
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address, timeout=PATIENCE_S) as page:
            assert b"<html" in page.read(2000).lower()
    finally:
        process.send_signal(stop)
    assert process.wait(PATIENCE_S) == 0
    said = (tmp_path / "log").read_text()
    assert "serve" in said and "Traceback" not in said and "viser" not in said


@pytest.mark.gate
def test_without_a_recording_it_shows_a_live_rally_whose_simulation_ends_with_it(serve_recording, tmp_path) -> None:
    recordings = tmp_path / "data" / "recordings"
    recordings.mkdir(parents=True)
    shutil.copy(serve_recording, recordings / "demo.h5")  # else it would be simulated first
    process, _ = start(["--port", "0", "--data", str(tmp_path / "data")], tmp_path / "log")
    started = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    try:
        assert "'live'" in (tmp_path / "log").read_text()
        children = eventually(lambda: started.read_text().split(), "the simulation to start")  # after its page
    finally:
        process.kill()  # no time to say goodbye
    process.wait(PATIENCE_S)
    alive = lambda: [child for child in children if is_alive(int(child))]  # noqa: E731
    eventually(lambda: not alive(), "what the app had started to end", alive)


def test_a_recording_is_replayed_as_live_and_starts_nothing_else(serve_recording, tmp_path) -> None:
    source = f"replay:{serve_recording}@0.5"
    process, _ = start(["--source", source, "--port", "0", "--data", str(tmp_path / "data")], tmp_path / "log")
    try:
        assert "'live'" in (tmp_path / "log").read_text()
    finally:
        process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_what_follows_the_last_at_is_the_speed_unless_the_file_is_called_so(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("pair.h5", "me@home.h5", "pair.h5@2"):
        (tmp_path / name).touch()
    said = ("pair.h5", "pair.h5@0.5", "me@home.h5", "me@home.h5@3", "pair.h5@2", "pair.h5@2@4")
    found = [read_replay(f"replay:{one}") for one in said]
    assert [(one.path.name, one.speed) for one in found if one] == [
        ("pair.h5", 1.0), ("pair.h5", 0.5), ("me@home.h5", 1.0), ("me@home.h5", 3.0), ("pair.h5@2", 1.0),
        ("pair.h5@2", 4.0),
    ]  # fmt: skip
    assert read_replay("live") is None and read_replay("tcp://127.0.0.1:5555") is None


def test_its_own_simulation_is_told_the_physics_and_the_balls(tmp_path) -> None:
    states = tmp_path / "states.json"
    keys = ("pos_x", "pos_y", "pos_z", "vel_x", "vel_y", "vel_z", "w_vel_x", "w_vel_y", "w_vel_z")
    states.write_text(json.dumps([dict(zip(keys, (0, 1.2, 0.35, 0, -5.0, 1.0, 0, 0, 0), strict=True))]))
    told = ["--physics", "paper", "--ball-states", str(states)]
    assert serve.own_simulation(asked(*told), "live") == told
    assert serve.own_simulation(asked("--constants", "constants.json"), "live") == ["--constants", "constants.json"]
    assert serve.own_simulation(asked("--constants", "constants.json"), None) == [], "of what follows a recording"
    assert serve.own_simulation(asked(), None) == []


def test_the_physics_of_cameras_and_a_replay_are_for_the_robot_that_plays() -> None:
    given = ("--robot", "tcp://127.0.0.1:5600", "--physics", "real")
    for source in ("replay:pair.h5", "camera:1,2"):
        assert serve.rally_physics(asked(*given), source) == physics_profile("real")
        assert serve.own_simulation(asked(*given), source) == []
        assert serve.rally_physics(asked(*given[2:]), source) is None
    assert serve.rally_physics(asked(*given), "tcp://127.0.0.1:5555") is None


def test_a_folder_is_named_again_for_each_and_the_recording_may_follow() -> None:
    arguments = asked("--folder", "a", "--folder", "b", "demo.h5")
    assert arguments.folder == (Path("a"), Path("b")) and arguments.recording == Path("demo.h5")
    assert asked().folder is None


def test_a_port_in_use_is_one_clear_line(serve_recording, tmp_path, capsys) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        code = main(["serve", str(serve_recording), "--port", str(port), "--data", str(tmp_path / "data")])
    error = capsys.readouterr().err
    assert code == 2 and f"127.0.0.1:{port}" in error and "--port" in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no-such-file.raw"], "no-such-file.raw"),
        (["--source", "udp://127.0.0.1:1"], "not a source"),
        (["--source", "replay:"], "no file to replay"),
        (["--source", "replay:no-such-file.h5"], "no such file to replay"),
        (["--source", "replay:no-such-file.h5@2"], "no such file to replay"),
        (["--source", "replay:{data}/recordings/demo.h5@fast"], "not a speed of a replay"),
        (["--source", "replay:{data}/recordings/demo.h5@"], "not a speed of a replay"),
        (["--source", "replay:{data}/recordings/demo.h5@nan"], "not a speed of a replay"),
        (["--source", "replay:{data}/recordings/demo.h5@0"], "0.01 to 20"),
        (["--source", "replay:{data}/recordings/demo.h5@-1"], "0.01 to 20"),
        (["--source", "replay:{data}/notes.txt"], "notes.txt"),
        (["--source", "replay:{data}/recordings/demo.h5", "--physics", "real"], "not a simulation of its own"),
        (["--source", "replay:{data}/recordings/demo.h5", "--keys", "no-such-folder"], "keys without a source"),
        (["--source", "tcp://127.0.0.1:1"], "no answer from a simulation server"),
        (["demo.h5", "--source", "live"], "a recording and a source"),
        (["--source", "tcp://192.0.2.1:5555"], "needs keys"),
        (["--source", "tcp://127.0.0.1:1", "--keys", "no-such-folder"], "no-such-folder"),
        (["--keys", "no-such-folder"], "keys without a source"),
        (["--robot", "tcp://127.0.0.1:5600"], "nothing that this robot could play to"),
        (["demo.h5", "--robot", "tcp://127.0.0.1:5600"], "nothing that this robot could play to"),
        (["--robot-keys", "no-such-folder"], "keys without a robot"),
        (["--source", "replay:{data}/recordings/demo.h5", "--robot", "/dev/arm"], "not an address"),
        (["--source", "replay:{data}/recordings/demo.h5", "--robot", "tcp://192.0.2.1:5600"], "expected --robot-keys"),
        (["--config", "no-such.toml"], "no-such.toml"),
        (["--port", "99999999"], "cannot listen"),
        (["--ball-states", "no-such.json"], "no-such.json"),
        (["--source", "tcp://127.0.0.1:1", "--physics", "real"], "not a simulation of its own"),
        (["demo.h5", "--physics", "real"], "not a simulation of its own"),
        (["--rerun", "http://127.0.0.1:9876"], "not a Rerun viewer"),
        (["--port", "http"], "expected a whole number"),
        (["--folder", "no-such-folder"], "not a folder"),
    ],
)
def test_bad_arguments_are_one_clear_line(
    arguments: list[str], message: str, tmp_path, capsys, serve_recording
) -> None:
    data = tmp_path / "data" / "recordings"
    data.mkdir(parents=True)
    shutil.copy(serve_recording, data / "demo.h5")
    (tmp_path / "data" / "notes.txt").write_text("this is no recording")
    arguments = [word.format(data=tmp_path / "data") for word in arguments]
    code = main(["serve", *arguments, "--data", str(tmp_path / "data")])
    error = capsys.readouterr().err
    assert code == 2 and message in error and error.count("\n") == 1


def test_a_browser_cannot_open_a_tunnel_to_the_world(serve_recording, tmp_path) -> None:
    from app.server import App
    from app.shared.library import Library
    from app.shared.workspace import Workspace

    workspace = Workspace(tmp_path)
    shutil.copy(serve_recording, workspace.recording_path("serve"))
    lab = App(workspace, Library(workspace), "serve", host="127.0.0.1", port=0)
    try:
        assert lab.viser_server.request_share_url() is None
        assert lab.viser_server.get_host() == "127.0.0.1"
    finally:
        lab.stop()
