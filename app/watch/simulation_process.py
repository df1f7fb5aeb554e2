"""`rallyscope sim-server` as a child of the app."""

from __future__ import annotations

import subprocess
import sys
import threading
from typing import Final

from core.errors import LinkError

STARTS_WITHIN_S: Final = 180.0
"""A fresh installation compiles the simulation first."""


class SimulationProcess:
    """Starts at once; `wait` gives its address."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "app.cli", "sim-server", "--bind", "tcp://127.0.0.1:0", "--until-eof"]
        self._process = subprocess.Popen(  # its input ends with this process, however that ends, and so does it
            [*command, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self._address = ""
        self._told = threading.Event()
        threading.Thread(target=self._read, name="simulation-process", daemon=True).start()

    def wait(self) -> str:
        """Where it listens.

        Raises:
            LinkError: if it does not come up.
        """
        self._told.wait(STARTS_WITHIN_S)
        if not self._address:
            self.stop()
            raise LinkError("the simulation did not start", remedy="run `rallyscope sim-server` to see why")
        return self._address

    def stop(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(timeout=5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if "tcp://" in line and not self._address:
                self._address = line[line.index("tcp://") :].split()[0]
                self._told.set()
        self._told.set()
