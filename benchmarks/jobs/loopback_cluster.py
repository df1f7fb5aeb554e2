"""A scheduler and workers of Dask on this machine, gone at the end whatever happens."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from core.errors import JobsError
from core.files import read_json

ROOT: Final = Path(__file__).parents[2]
START_S: Final = 60.0


@contextmanager
def loopback_cluster(workers: int) -> Iterator[str]:
    """Yields the scheduler's address.

    Raises:
        JobsError: if it does not start.
    """
    processes: list[subprocess.Popen[bytes]] = []
    with tempfile.TemporaryDirectory(prefix="rallyscope-") as folder:
        try:
            place = Path(folder) / "scheduler.json"
            local = ("--host", "127.0.0.1", "--no-dashboard")
            processes.append(_start("scheduler", *local, "--port", "0", "--scheduler-file", str(place)))
            address = _address(place)
            for _ in range(workers):
                more = ("--nthreads", "1", "--no-nanny", "--local-directory", folder)
                processes.append(_start("worker", address, *local, *more))
            yield address
        finally:
            for process in reversed(processes):
                process.kill()
                process.wait()


def _start(*arguments: str) -> subprocess.Popen[bytes]:
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    quiet = subprocess.DEVNULL
    command = [sys.executable, "-m", "dask", *arguments]
    return subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path}, stdin=quiet, stdout=quiet, stderr=quiet)


def _address(place: Path) -> str:
    end_s = time.monotonic() + START_S
    while time.monotonic() < end_s:
        if address := read_json(place).get("address"):
            return str(address)
        time.sleep(0.05)
    raise JobsError("no scheduler of Dask has started", remedy="pip install 'rallyscope[cluster]'")
