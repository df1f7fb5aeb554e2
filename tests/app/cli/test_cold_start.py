"""Every verb that computes, started where nothing has been compiled, or where nothing that is compiled can be kept."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

CLI = [sys.executable, "-m", "app.cli"]
WITHIN_S = 280


def run(arguments: list[str], cache: Path) -> subprocess.CompletedProcess:
    """A verb with its own cache of compiled kernels."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run([*CLI, *arguments], capture_output=True, text=True, env=environment, timeout=WITHIN_S)


def rows(path: Path) -> int:
    return len(path.read_text().splitlines()) - 1


@pytest.mark.parametrize("keeps", [True, False])
def test_detect(serve_recording, tmp_path, keeps) -> None:
    file = tmp_path / "file"
    file.touch()
    cache = tmp_path / "cache" if keeps else file / "cache"  # a folder cannot be made in a file
    out = tmp_path / "det.csv"
    done = run(["detect", str(serve_recording), "--camera", "left", "--out", str(out)], cache)
    assert done.returncode == 0, done.stderr
    assert rows(out) > 100
    assert len(list(tmp_path.glob("cache/**/*.kernel"))) > 20 or not keeps
    assert ("every start compiles again" in done.stderr) is not keeps


def test_track(serve_recording, tmp_path) -> None:
    out = tmp_path / "track.csv"
    done = run(["track", str(serve_recording), "--out", str(out)], tmp_path / "cache")
    assert done.returncode == 0, done.stderr
    assert rows(out) > 80


def test_simulate(tmp_path) -> None:
    out = tmp_path / "one.h5"
    done = run(["simulate", "--out", str(out), "--sensor", "160x120", "--json"], tmp_path / "cache")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) and out.exists()


def test_train(tmp_path) -> None:
    out = tmp_path / "run"
    arguments = ["train", "--speeds", "3", "--episodes", "80", "--out", str(out)]
    done = run(arguments, tmp_path / "cache")
    assert done.returncode == 0, done.stderr
    assert (out / "config.toml").exists()


@pytest.mark.parametrize(("option", "name"), [("--evt3", "events"), ("--rrd", "one.rrd")])
def test_export(serve_recording, tmp_path, option, name) -> None:
    out = tmp_path / name
    arguments = ["export", str(serve_recording), option, str(out), "--end-us", "100000"]
    done = run(arguments, tmp_path / "cache")
    assert done.returncode == 0, done.stderr
    assert out.exists()


def test_a_client_of_a_server_that_compiles_gets_its_answer(tmp_path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    port = free_pair_of_ports()
    bind = ["--bind", f"tcp://127.0.0.1:{port}", "--sensor", "64x48"]
    server = subprocess.Popen(
        [*CLI, "sim-server", *bind], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    asking = (
        "import sys, time; from core.rally.link.client import SimulationClient; from core.errors import NoAnswerError\n"
        "shares = []\n"
        "while True:\n"
        "    try: client = SimulationClient(sys.argv[1], preparing=shares.append); break\n"
        "    except NoAnswerError: time.sleep(0.2)\n"  # the server's process is still loading
        "assert client.serve().ok; client.close(); print(len(shares), max(shares))"
    )
    try:
        done = subprocess.run(
            [sys.executable, "-c", asking, f"tcp://127.0.0.1:{port}"], capture_output=True, text=True, timeout=WITHIN_S
        )
        assert done.returncode == 0, done.stderr
        answers, share = done.stdout.split()
        assert int(answers) > 5 and 0.5 < float(share) <= 1
    finally:
        server.send_signal(signal.SIGTERM)
        said, complained = server.communicate(timeout=60)
    assert server.returncode == 0
    assert said.startswith(f"The simulation is at tcp://127.0.0.1:{port}")
    assert "compiling, on the first start only" in complained


def free_pair_of_ports() -> int:
    """A port that is free like the next one."""
    import zmq

    with zmq.Context() as context, context.socket(zmq.PUB) as one, context.socket(zmq.PUB) as other:
        while True:
            port = one.bind_to_random_port("tcp://127.0.0.1", max_port=60000)
            try:
                other.bind(f"tcp://127.0.0.1:{port + 1}")
            except zmq.ZMQError:
                one.unbind(f"tcp://127.0.0.1:{port}")
                continue
            return port
