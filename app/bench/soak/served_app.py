"""The app in a process of its own, as `rallyscope serve` starts it."""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.bench.soak.process_usage import children_of
from core.errors import CommandError


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
        process.terminate()
        try:
            process.wait(timeout=60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        assert process.stdout is not None
        process.stdout.close()
