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


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for kernels that is empty before the first test of this file.

    The verbs fill it in the order of this file: what one shares with an earlier one is not compiled a second time.
    `run_cold` holds that each still meets kernels that nobody has compiled, and alone each meets an empty folder. The
    server stands before `simulate`, whose kernels are nearly the same: it has a client that must not give up meanwhile.
    """
    return tmp_path_factory.mktemp("kernels")


def run(arguments: list[str], cache: Path) -> subprocess.CompletedProcess:
    """A verb with a cache of compiled kernels that is not this user's."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run([*CLI, *arguments], capture_output=True, text=True, env=environment, timeout=WITHIN_S)


def run_cold(arguments: list[str], cache: Path) -> subprocess.CompletedProcess:
    """A verb that works, and has compiled something new for it."""
    before = kernels(cache)
    done = run(arguments, cache)
    assert done.returncode == 0, done.stderr
    assert kernels(cache) > before, "it met nothing that was not compiled: it has to come earlier in this file"
    return done


def kernels(cache: Path) -> int:
    return len(list(cache.glob("**/*.kernel")))


def rows(path: Path) -> int:
    return len(path.read_text().splitlines()) - 1


def test_detect(serve_recording, tmp_path, cache) -> None:
    out = tmp_path / "det.csv"
    assert kernels(cache) == 0, "this verb is the first"
    done = run_cold(["detect", str(serve_recording), "--camera", "left", "--out", str(out)], cache)
    assert rows(out) > 100
    assert kernels(cache) > 10
    assert "every start compiles again" not in done.stderr


def test_detect_where_nothing_can_be_kept(serve_recording, tmp_path) -> None:
    file = tmp_path / "file"
    file.touch()
    out = tmp_path / "det.csv"
    arguments = ["detect", str(serve_recording), "--camera", "left", "--out", str(out)]
    done = run(arguments, file / "cache")  # a folder cannot be made in a file
    assert done.returncode == 0, done.stderr
    assert rows(out) > 100
    assert "every start compiles again" in done.stderr


def test_track(serve_recording, tmp_path, cache) -> None:
    out = tmp_path / "track.csv"
    run_cold(["track", str(serve_recording), "--out", str(out)], cache)
    assert rows(out) > 80


@pytest.mark.parametrize(("option", "name"), [("--evt3", "events"), ("--rrd", "one.rrd")])
def test_export(serve_recording, tmp_path, cache, option, name) -> None:
    out = tmp_path / name
    arguments = ["export", str(serve_recording), option, str(out), "--end-us", "100000"]
    run_cold([*arguments, "--method", "auto"], cache)  # what `refined` takes, `track` has compiled
    assert out.exists()


def test_a_client_of_a_server_that_compiles_gets_its_answer(cache) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    port = free_pair_of_ports()
    bind = ["--bind", f"tcp://127.0.0.1:{port}", "--sensor", "64x48"]
    server = subprocess.Popen(
        [*CLI, "sim-server", *bind], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    asking = (
        "import sys, time; from core.live.link.client import SimulationClient; from core.errors import NoAnswerError\n"
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


def test_simulate(tmp_path, cache) -> None:
    out = tmp_path / "one.h5"
    done = run_cold(["simulate", "--out", str(out), "--sensor", "160x120", "--json"], cache)
    assert json.loads(done.stdout) and out.exists()


def test_train(tmp_path, cache) -> None:
    out = tmp_path / "run"
    run_cold(["train", "--speeds", "3", "--episodes", "80", "--out", str(out)], cache)
    assert (out / "config.toml").exists()


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
