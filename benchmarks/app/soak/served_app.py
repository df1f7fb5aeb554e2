"""The app in a process of its own, as `rallyscope serve` starts it."""

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

from benchmarks.app.soak.process_usage import children_of
from core.errors import CommandError

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
            raise CommandError("the app did not come up", got=said.read_text()[-300:])
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
