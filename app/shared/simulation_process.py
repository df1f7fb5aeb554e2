"""`rallyscope sim-server` as a child of the app."""

from __future__ import annotations

import threading
from collections.abc import Callable

from app.background.child import ChildProcess, share_in
from core.errors import LinkError


class SimulationProcess:
    """The simulation's process; it starts at once, `wait` returns its address."""

    def __init__(self, *arguments: str, on_progress: Callable[[float], None] = lambda share: None) -> None:
        """`arguments` of the verb; `on_progress` gets the compiled share, 0 to 1."""
        self._address = ""
        self._started = threading.Event()
        self._on_progress = on_progress
        command = ("app.cli", "sim-server", "--bind", "tcp://127.0.0.1:0", "--until-eof", *arguments)
        self._child = ChildProcess(*command, on_line=self._hear, on_end=self._started.set)

    def wait(self) -> str:
        """Wait for its address; a slow machine may compile for minutes.

        Raises:
            LinkError: if it ends before.
        """
        self._started.wait()
        if not self._address:
            remedy = "run `rallyscope sim-server` to see why"
            raise LinkError("the simulation did not start", got=self._child.last_words, remedy=remedy)
        return self._address

    def stop(self) -> None:
        """End the simulation's process."""
        self._child.stop()

    def _hear(self, line: str) -> None:
        share = share_in(line)
        if share is not None:
            self._on_progress(share)
        elif "tcp://" in line and not self._address:
            self._address = line[line.index("tcp://") :].split()[0]
            self._started.set()
