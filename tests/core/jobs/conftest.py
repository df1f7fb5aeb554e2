"""Real Dask clusters on loopback, gone at the end whatever happens, and the module of pieces for all processes."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from core.text import parse_json
from tests.waiting import PATIENCE_S, eventually

HERE = Path(__file__).parent
ROOT = HERE.parents[2]


@dataclass
class DaskCluster:
    """A scheduler and workers as a user starts them."""

    folder: Path
    processes: list[subprocess.Popen] = field(default_factory=list)
    address: str = ""

    def start(self, workers: int, *more: str, **environment: str) -> None:
        place = self.folder / "scheduler.json"
        host = ("--host", "127.0.0.1", "--no-dashboard")
        self._run("scheduler", *host, "--port", "0", "--scheduler-file", str(place), **environment)
        eventually(lambda: place.exists() and place.read_text().endswith("}"), "the scheduler's address")
        self.address = parse_json(place.read_text())["address"]
        for _ in range(workers):
            self.add_worker(*more, **environment)
        eventually(lambda: self._registered() == workers, "the workers to be known to the scheduler", self._registered)

    def _registered(self) -> int:
        return sum(b"Registered to" in log.read_bytes() for log in self.folder.glob("worker-*.log"))

    def add_worker(self, *more: str, **environment: str) -> subprocess.Popen:
        place = ("--local-directory", str(self.folder), "--host", "127.0.0.1", "--no-dashboard")
        return self._run("worker", self.address, "--nthreads", "1", *place, *more, **environment)

    def end(self) -> None:
        for process in reversed(self.processes):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(PATIENCE_S)

    def _run(self, *arguments: str, **environment: str) -> subprocess.Popen:
        path = os.pathsep.join(map(str, (ROOT, HERE)))
        log = (self.folder / f"{arguments[0]}-{len(self.processes)}.log").open("wb")
        with log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments],
                env=os.environ | {"PYTHONPATH": path} | environment,
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # a nanny's worker goes with it
            )
        self.processes.append(process)
        return process


@pytest.fixture
def free_port() -> Iterator[int]:
    """Where nobody listens, and nobody can: it is held meanwhile."""
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        yield holder.getsockname()[1]


@pytest.fixture(autouse=True)
def _pieces_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(HERE)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    """Two workers that nobody harms."""
    pytest.importorskip("distributed")
    found = DaskCluster(tmp_path_factory.mktemp("cluster"))
    try:
        found.start(2, "--no-nanny")
        yield found
    finally:
        found.end()


@pytest.fixture
def own_cluster(tmp_path: Path) -> Iterator[DaskCluster]:
    """One to be started, and harmed."""
    pytest.importorskip("distributed")
    (folder := tmp_path / "cluster").mkdir()
    found = DaskCluster(folder)
    try:
        yield found
    finally:
        found.end()
