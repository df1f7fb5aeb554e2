"""The first start on a machine: nothing compiled, nothing made, a page at once, and then a ball that comes back.

Verbs that follow on that machine find what the app has compiled, and compile what is their own. Without a browser they
are the first, and compile everything.
"""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
import zmq

from tests.app.browser.window import FEW_FRAMES, open_page, save_screenshot
from tests.waiting import PATIENCE_S, eventually

CLI = [sys.executable, "-m", "app.cli"]
COLD_S = 1000
"""For all that is compiled: an upper end, should something hang. Nothing in the product gives up after a time."""
SIMULATION = "core.simulation.event_cameras"
"""Where the kernels of the simulated cameras come from, among the largest."""
WORK_S = 1
"""Processor time that shows that a process is at work: a kernel may take longer to compile than a test's patience."""


def wait_while_it_compiles(
    until: Callable[[], object], process: subprocess.Popen, what: str, seen: Callable[[], object]
) -> None:
    """Return once a condition holds; all work of the process meanwhile is worth the patience of a test."""
    done = False
    while not done:
        before_s = worked_s(process)

        def gets_on(before_s: float = before_s) -> bool:
            nonlocal done
            done = bool(until())
            return done or abs(worked_s(process) - before_s) > WORK_S

        eventually(gets_on, what, seen)


def worked_s(process: subprocess.Popen) -> float:
    """Processor time of a process and of all that it started; zero once it is over."""
    total_s = 0.0
    with contextlib.suppress(psutil.NoSuchProcess):
        one = psutil.Process(process.pid)
        for part in (one, *one.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):
                total_s += sum(part.cpu_times()[:4])  # user, system, and the two of children that are over
    return total_s


class Started:
    """`rallyscope serve` as `make run` starts it, but for the browser that it would open."""

    def __init__(self, folder: Path, cache: Path) -> None:
        self._log = folder / "log"
        command = [*CLI, "serve", "--port", "0", "--data", str(folder / "data")]
        with self._log.open("w") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, env=environment_of(cache))

    @property
    def said(self) -> str:
        return self._log.read_text()

    def address(self) -> str:
        """Of the page, as soon as it is said."""
        self.wait(lambda: re.search(r"http://\S+", self.said) is not None, "the address of the page")
        return re.findall(r"http://\S+", self.said)[0]

    def wait(self, until: Callable[[], bool], what: str) -> None:
        """For what comes when everything has been compiled."""

        def is_there() -> bool:
            assert self.process.poll() is None, self.said
            return until()

        wait_while_it_compiles(is_there, self.process, what, lambda: self.said)

    def end(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE_S) == 0, self.said


def environment_of(cache: Path) -> dict[str, str]:
    """That of a process with compiled kernels of its own, not this user's."""
    return {**os.environ, "NUMBA_CACHE_DIR": str(cache)}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for kernels that is empty before the first test of this file."""
    return tmp_path_factory.mktemp("kernels")


@pytest.fixture
def cold(tmp_path, cache) -> Iterator[Started]:
    for kernels in cache.iterdir():  # of an attempt before
        shutil.rmtree(kernels)
    started = Started(tmp_path, cache)
    yield started
    started.process.kill()


@pytest.mark.timeout(COLD_S)
def test_the_first_start_shows_a_page_then_a_returned_ball(cold, chromium, tmp_path) -> None:
    page = open_page(chromium)
    page.add_init_script(FEW_FRAMES)  # drawing has its turn, but compiling is what is waited for
    page.goto(cold.address())
    for words in ("Compiling the simulation", "you see a recorded rally", re.compile(r"^\d+%$")):
        cold.wait(page.get_by_text(words).first.is_visible, str(words))
    save_screenshot(page, "cold-preparing")
    returned = page.get_by_text(re.compile(r"^[1-9]\d* of \d+$"))  # counted by controller and scene
    cold.wait(lambda: returned.count() > 0, "a ball to be returned")
    first = save_screenshot(page, "cold-returned")
    cold.wait(lambda: _differ(first, save_screenshot(page, "cold-returned-later")), "the scene to move")
    cold.wait(page.get_by_text("Getting ready").is_hidden, "everything to be ready")  # the demo recording is made, too
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


def run(command: list[str], cache: Path, folder: Path, server: subprocess.Popen | None = None) -> str:
    """What a process says, with a cache of compiled kernels of its own; the server is the one that it waits for."""
    said, complained = folder / "said", folder / "complained"
    with said.open("w") as out, complained.open("w") as err:
        process = subprocess.Popen(command, stdout=out, stderr=err, env=environment_of(cache))
    try:
        ended = lambda: process.poll() is not None  # noqa: E731
        wait_while_it_compiles(ended, server or process, f"the end of {command}", complained.read_text)
    finally:
        process.kill()
    assert process.wait(PATIENCE_S) == 0, complained.read_text()
    return said.read_text()


@pytest.mark.timeout(COLD_S)
def test_a_client_of_a_server_that_compiles_gets_its_answer(cache, tmp_path) -> None:
    for kernels in cache.glob(f"*/{SIMULATION}*"):  # so that there is something left to compile
        shutil.rmtree(kernels)
    port = free_pair_of_ports()
    bind = ["--bind", f"tcp://127.0.0.1:{port}", "--sensor", "64x48"]
    server = subprocess.Popen(
        [*CLI, "sim-server", *bind],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment_of(cache),
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
        answer = run([sys.executable, "-c", asking, f"tcp://127.0.0.1:{port}"], cache, tmp_path, server)
        answers, steps, share = answer.split()
        assert int(answers) > 5 and int(steps) > 2 and 0 < float(share) <= 1, "it hears how far the server is"
    finally:
        server.send_signal(signal.SIGTERM)
        said, complained = server.communicate(timeout=PATIENCE_S)
    assert server.returncode == 0
    assert said.startswith(f"The simulation is at tcp://127.0.0.1:{port}")
    assert "compiling, on the first start only" in complained


def rows(path: Path) -> int:
    return len(path.read_text().splitlines()) - 1


@pytest.mark.timeout(COLD_S)
def test_track(serve_recording, tmp_path, cache) -> None:
    out = tmp_path / "track.csv"
    run([*CLI, "track", str(serve_recording), "--out", str(out)], cache, tmp_path)
    assert rows(out) > 80


@pytest.mark.timeout(COLD_S)
@pytest.mark.parametrize(("option", "name"), [("--evt3", "events"), ("--rrd", "one.rrd")])
def test_export(serve_recording, tmp_path, cache, option, name) -> None:
    out = tmp_path / name
    run([*CLI, "export", str(serve_recording), option, str(out), "--end-us", "100000"], cache, tmp_path)
    assert out.exists()


@pytest.mark.timeout(COLD_S)
def test_simulate(tmp_path, cache) -> None:
    out = tmp_path / "one.h5"
    said = run([*CLI, "simulate", "--out", str(out), "--sensor", "160x120", "--json"], cache, tmp_path)
    assert json.loads(said) and out.exists()


@pytest.mark.timeout(COLD_S)
def test_train(tmp_path, cache) -> None:
    out = tmp_path / "run"
    run([*CLI, "train", "--speeds", "3", "--episodes", "80", "--out", str(out)], cache, tmp_path)
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
