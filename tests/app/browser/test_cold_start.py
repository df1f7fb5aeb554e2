"""The first start on a machine: nothing compiled, nothing made, a page at once, and then a ball that comes back.

Verbs that follow on that machine find what the app has compiled, and compile what is their own. Without a browser they
are the first, and compile everything.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zmq
from playwright.sync_api import Page

from tests.app.browser.conftest import FEW_FRAMES

CLI = [sys.executable, "-m", "app.cli"]
PAGE_WITHIN_S = 60.0
READY_WITHIN_S = 900.0
"""On a machine that does other things as well. Nothing in the product gives up after a time."""
VERB_WITHIN_S = 280
SIMULATION = "core.simulation.event_cameras"
"""Where the kernels of the simulated cameras come from, among the largest."""


class Started:
    """`rallyscope serve` as `make run` starts it, but for the browser that it would open."""

    def __init__(self, folder: Path, *arguments: str, **environment: str) -> None:
        self.began_s = time.monotonic()
        self._log = folder / "log"
        command = [*CLI, "serve", "--port", "0", "--data", str(folder / "data"), *arguments]
        with self._log.open("w") as out:
            self.process = subprocess.Popen(
                command, stdout=out, stderr=subprocess.STDOUT, env={**os.environ, **environment}
            )

    @property
    def said(self) -> str:
        return self._log.read_text()

    def address(self) -> str:
        """Of the page, as soon as it is said."""
        while time.monotonic() - self.began_s < PAGE_WITHIN_S and self.process.poll() is None:
            found = re.search(r"http://\S+", self.said)
            if found:
                return found.group()
            time.sleep(0.1)
        raise AssertionError(self.said)

    def wait(self, page: Page, until: Callable[[], bool]) -> None:
        """For what comes when everything has been compiled."""
        while not until():
            assert time.monotonic() - self.began_s < READY_WITHIN_S, self.said
            assert self.process.poll() is None, self.said
            page.wait_for_timeout(200)

    def end(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(300) == 0, self.said


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for kernels that is empty before the first test of this file."""
    return tmp_path_factory.mktemp("kernels")


@pytest.fixture
def cold(tmp_path, cache) -> Iterator[Started]:
    assert not list(cache.iterdir()), "this test is the first"
    started = Started(tmp_path, NUMBA_CACHE_DIR=str(cache))
    yield started
    started.process.kill()


@pytest.mark.timeout(1000)
def test_the_first_start_shows_a_page_then_a_returned_ball(cold, chromium, tmp_path, save_screenshot) -> None:
    page = chromium.new_page(viewport={"width": 1280, "height": 720})
    page.add_init_script(FEW_FRAMES)  # drawing has its turn, but compiling is what is waited for
    page.goto(cold.address(), timeout=90_000)
    page.get_by_text("Compiling the simulation").wait_for(timeout=90_000)
    page.get_by_text(re.compile(r"^\d+%$")).first.wait_for(timeout=90_000)
    save_screenshot(page, "cold-preparing")
    returned = page.get_by_text(re.compile(r"^[1-9]\d* of \d+$"))  # counted by controller and scene
    cold.wait(page, lambda: returned.count() > 0)
    first = save_screenshot(page, "cold-returned")
    cold.wait(page, lambda: _differ(first, save_screenshot(page, "cold-returned-later")))
    cold.wait(page, page.get_by_text("Getting ready").is_hidden)  # the demo recording is made, too
    assert (tmp_path / "data" / "recordings" / "demo.h5").exists()
    page.close()
    cold.end()
    for words in ("Compiling the simulation", "Compiling the ball detector", "Making the demo recording"):
        assert re.search(f"{words}.* \\.\\.\\.\n", cold.said), cold.said
        assert re.search(f"{words}.*: done after \\d+ s\n", cold.said), cold.said
    assert "Traceback" not in cold.said


def _differ(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether something has moved from one picture to the other."""
    return np.count_nonzero(np.abs(first.astype(int) - second).max(axis=-1) > 40) > 50


def run(arguments: list[str], cache: Path) -> subprocess.CompletedProcess:
    """A verb that works with a cache of compiled kernels that is not this user's."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run([*CLI, *arguments], capture_output=True, text=True, env=environment, timeout=VERB_WITHIN_S)
    assert done.returncode == 0, done.stderr
    return done


def test_a_client_of_a_server_that_compiles_gets_its_answer(cache) -> None:
    for kernels in cache.glob(f"*/{SIMULATION}*"):  # so that there is something left to compile
        shutil.rmtree(kernels)
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
        "assert client.serve().ok; client.close(); print(len(shares), len(set(shares)), max(shares))"
    )
    try:
        done = subprocess.run(
            [sys.executable, "-c", asking, f"tcp://127.0.0.1:{port}"],
            capture_output=True,
            text=True,
            timeout=VERB_WITHIN_S,
        )
        assert done.returncode == 0, done.stderr
        answers, steps, share = done.stdout.split()
        assert int(answers) > 5 and int(steps) > 2 and 0 < float(share) <= 1, "it hears how far the server is"
    finally:
        server.send_signal(signal.SIGTERM)
        said, complained = server.communicate(timeout=60)
    assert server.returncode == 0
    assert said.startswith(f"The simulation is at tcp://127.0.0.1:{port}")
    assert "compiling, on the first start only" in complained


def rows(path: Path) -> int:
    return len(path.read_text().splitlines()) - 1


def test_track(serve_recording, tmp_path, cache) -> None:
    out = tmp_path / "track.csv"
    run(["track", str(serve_recording), "--out", str(out)], cache)
    assert rows(out) > 80


@pytest.mark.parametrize(("option", "name"), [("--evt3", "events"), ("--rrd", "one.rrd")])
def test_export(serve_recording, tmp_path, cache, option, name) -> None:
    out = tmp_path / name
    run(["export", str(serve_recording), option, str(out), "--end-us", "100000"], cache)
    assert out.exists()


def test_simulate(tmp_path, cache) -> None:
    out = tmp_path / "one.h5"
    done = run(["simulate", "--out", str(out), "--sensor", "160x120", "--json"], cache)
    assert json.loads(done.stdout) and out.exists()


def test_train(tmp_path, cache) -> None:
    out = tmp_path / "run"
    run(["train", "--speeds", "3", "--episodes", "80", "--out", str(out)], cache)
    assert (out / "config.toml").exists()


def free_pair_of_ports() -> int:
    """A port that is free like the next one."""
    with zmq.Context() as context, context.socket(zmq.PUB) as one, context.socket(zmq.PUB) as other:
        while True:
            port = one.bind_to_random_port("tcp://127.0.0.1", max_port=60000)
            try:
                other.bind(f"tcp://127.0.0.1:{port + 1}")
            except zmq.ZMQError:
                one.unbind(f"tcp://127.0.0.1:{port}")
                continue
            return port
