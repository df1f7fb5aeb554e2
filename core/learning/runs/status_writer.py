"""Writer of a run's status: progress, time left, and how it ended."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from core.learning.config import RunConfig
from core.learning.runs.control import RunStatus, State, read_status, write_status
from core.learning.runs.seed_process import SeedProgress


class StatusWriter:
    """Writes the status of a run locked by this process; unknown fields keep their last values.

    Every method but `failed` raises OSError if the file cannot be written.
    """

    def __init__(self, run: Path, config: RunConfig) -> None:
        self._run, self._episodes = run, config.episodes
        self._began_s = time.monotonic()
        self._first_share: float | None = None
        fresh = RunStatus("running", os.getpid(), config.first_seed, 0, config.episodes, 0.0, 0.0, None)
        self._status = read_status(run) or fresh

    def tell(self, at: SeedProgress, share: float) -> None:
        """Write the current seed, and the share of all seeds that is done."""
        if self._first_share is None:
            self._first_share = share
        gone = share - self._first_share
        left_s = (time.monotonic() - self._began_s) * (1 - share) / gone if gone > 0 else None
        left_s = left_s and round(left_s, 1)
        now = RunStatus(at.state, os.getpid(), at.seed, at.episode, self._episodes, share, at.speed_mps, left_s)
        self._write(now)

    def ended(self, state: State) -> None:
        """Write that it was stopped or is finished."""
        whole = {"share": 1.0, "seconds_left": 0.0} if state == "finished" else {}
        self._write(replace(self._status, state=state, pid=os.getpid(), message="", **whole))

    def failed(self, message: str) -> None:
        """Write the error that ended it, if possible."""
        with suppress(OSError):
            self._write(replace(self._status, state="failed", pid=os.getpid(), message=message))

    def _write(self, status: RunStatus) -> None:
        self._status = status
        write_status(self._run, status)
