"""A Rerun viewer without a window, which saves what it is sent."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.waiting import PATIENCE_S, eventually


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def viewer(saved: Path) -> Iterator[tuple[str, subprocess.Popen]]:
    """A viewer without a window that writes what it is sent to a file."""
    port = free_port()
    command = [sys.executable, "-m", "rerun", "--save", str(saved), "--bind", "127.0.0.1", "--port", str(port)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, start_new_session=True, **quiet)
    try:
        eventually(lambda: is_open(port) or process.poll() is not None, "the viewer to start")
        assert process.poll() is None, "the viewer did not start"
        yield f"rerun+http://127.0.0.1:{port}/proxy", process
    finally:
        end(process)


def end(process: subprocess.Popen) -> None:
    """With its own child: `python -m rerun` starts the viewer as one."""
    if process.poll() is None:
        os.killpg(process.pid, 15)
    process.wait(PATIENCE_S)


def entities(path: Path) -> set[str]:
    """Of the rally; not those of the views, which are made anew each time."""
    command = [sys.executable, "-m", "rerun", "rrd", "stats", str(path)]
    section = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S).stdout.partition(
        "Num chunks per entity"
    )[2]
    found = {line.partition(":")[0].strip("/") for line in section.splitlines() if line.startswith("/")}
    return {one for one in found if one.startswith(("world", "pictures", "plots"))}
