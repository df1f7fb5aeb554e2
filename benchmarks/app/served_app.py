"""The app in a process of its own, as `rallyscope serve` starts it, and what a process holds: memory, threads, open
files. Read from /proc, so on Linux only.
"""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from core.errors import CommandError

PROC = Path("/proc")


@dataclass(frozen=True, slots=True)
class ProcessUsage:
    """One process at one time."""

    resident_mb: float
    """Memory that belongs to it alone: what it shares with others, such as libraries and files, is not counted."""
    threads: int
    handles: int
    """Open files, sockets and pipes."""


def usage_of(pid: int) -> ProcessUsage:
    """Memory, threads and files of a running process.

    Raises:
        CommandError: if it is not, or this is not Linux.
    """
    try:
        status = _numbers(PROC / str(pid) / "status")
        return ProcessUsage(status["RssAnon"] / 1e3, status["Threads"], len(list((PROC / str(pid) / "fd").iterdir())))
    except (OSError, KeyError) as error:
        raise CommandError("cannot see what a process holds", expected="one that runs, on Linux", got=pid) from error


def children_of(pid: int) -> tuple[int, ...]:
    """Processes that this one started itself and that still run."""
    found: list[int] = []
    for task in (PROC / str(pid) / "task").iterdir():
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread may end meanwhile
            found.extend(int(child) for child in (task / "children").read_text("utf-8").split())
    return tuple(found)


def _numbers(path: Path) -> dict[str, int]:
    """The lines NAME: NUMBER [kB]."""
    pairs = (line.partition(":") for line in path.read_text("utf-8").splitlines())
    return {name: int(value.split()[0]) for name, _, value in pairs if value.split() and value.split()[0].isdigit()}


HELPERS_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class ServedApp:
    """While it runs."""

    process: subprocess.Popen[bytes]
    port: int

    def simulation(self) -> int | None:
        """The process of its live rally, once there is one."""
        for pid in children_of(self.process.pid):
            if b"sim-server" in Path(f"/proc/{pid}/cmdline").read_bytes():
                return pid
        return None


@contextlib.contextmanager
def served(workspace: Path, *arguments: str, port: int = 0) -> Iterator[ServedApp]:
    """Serve a workspace, on any free port if none is given; without other arguments a live rally.

    Raises:
        CommandError: if it does not come up; with what it said.
    """
    said = workspace / "serve.log"
    command = [sys.executable, "-m", "app.cli", "serve", *arguments, "--data", str(workspace), "--port", str(port)]
    with said.open("wb") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log)
    try:
        assert process.stdout is not None
        address = next((re.search(rb"http://[^:]+:(\d+)", line) for line in process.stdout if b"http://" in line), None)
        if address is None:
            raise CommandError("the app did not come up", got=said.read_text("utf-8")[-300:])
        yield ServedApp(process, int(address[1]))
    finally:
        helpers = children_of(process.pid) if process.poll() is None else ()
        process.terminate()
        try:
            process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        _wait_for_end(helpers)
        assert process.stdout is not None
        process.stdout.close()


def _wait_for_end(helpers: tuple[int, ...]) -> None:
    """They end by themselves when the app has; a training first writes what it has into the workspace."""
    deadline = time.monotonic() + HELPERS_S
    while any(Path(f"/proc/{pid}").exists() for pid in helpers) and time.monotonic() < deadline:
        time.sleep(0.05)
