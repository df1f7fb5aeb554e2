"""A Rerun viewer without a window, which saves what it is sent."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from tests.waiting import PATIENCE_S, eventually


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def listens(process: subprocess.Popen, port: int) -> bool:
    """Whether it or a child of it does; another program may have taken the port meanwhile."""
    try:
        viewer = psutil.Process(process.pid)
        family = (viewer, *viewer.children(recursive=True))
        found = [one for each in family for one in each.net_connections("tcp")]
    except psutil.Error:  # one of them has just ended
        return False
    return any(one.status == psutil.CONN_LISTEN and one.laddr.port == port for one in found)


def start_viewer(saved: Path) -> tuple[int, subprocess.Popen]:
    """Its port, and a process that listens there or has ended."""
    port = free_port()
    command = [sys.executable, "-m", "rerun", "--save", str(saved), "--bind", "127.0.0.1", "--port", str(port)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, start_new_session=True, **quiet)
    try:
        eventually(lambda: listens(process, port) or process.poll() is not None, "the viewer to start")
    except AssertionError:
        end(process)
        raise
    return port, process


@contextmanager
def viewer(saved: Path) -> Iterator[tuple[str, subprocess.Popen]]:
    """A viewer without a window that writes what it is sent to a file."""
    port, process = start_viewer(saved)
    for _ in range(3):  # the port may be another program's by now
        if process.poll() is not None:
            port, process = start_viewer(saved)
    try:
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
