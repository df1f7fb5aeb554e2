"""The one stream to the Rerun viewer given on the command line, shared by all browsers."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from app.background.jobs import Job
from app.export.unfinished import Cancelled, Progress
from core.errors import CommandError, RallyscopeError

logger = logging.getLogger(__name__)
ADDRESS: Final = re.compile(r"rerun(\+https?)?://(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+):\d{1,5}/proxy")
CLOSE_WITHIN_S: Final = 8.0
StreamWork = Callable[[Progress, Cancelled, Callable[[str], None]], None]
"""Sends until done or cancelled; the third argument takes a remark for the user."""


def check_viewer_address(address: str) -> str:
    """Check the address of a viewer.

    Raises:
        CommandError: if it is none.
    """
    if not ADDRESS.fullmatch(address):
        raise CommandError(
            "not a Rerun viewer", expected="rerun+http://HOST:PORT/proxy", got=repr(address[:200]), where="--rerun"
        )
    return address


@dataclass(frozen=True, slots=True)
class StreamState:
    """State of the latest stream."""

    name: str
    """Name of the recording."""
    running: bool
    share: float
    """Progress, 0..1; stays 0 for a live rally, which has no end."""
    message: str
    """Result, or a remark while it runs; may be empty."""
    failed: bool


class ViewerStreamer:
    """Shared by all browsers; every method may be called from any thread."""

    def __init__(self, address: str | None) -> None:
        self.address = address
        """None: the command line gave none, and nothing can be streamed."""
        self._lock = threading.Lock()
        self._job: Job[None] | None = None
        self._name, self._message = "", ""
        self._over = self._failed = False

    def start(self, name: str, work: StreamWork) -> None:
        """Begin.

        Raises:
            CommandError: if something is being streamed already.
        """
        with self._lock:
            if self._job is not None and self._job.running:
                raise CommandError("the viewer is being sent something already", got=self._name, remedy="stop it first")
            self._name, self._message, self._over, self._failed = name, "", False, False
            self._job = Job(lambda progress, cancelled: work(progress, cancelled, self._remark), self._done, self._lost)

    def stop(self) -> None:
        """Stop the running stream; the viewer keeps what it has."""
        with self._lock:
            if self._job is not None and self._job.running and not self._over:
                self._job.cancel()
                self._over, self._message = True, f"{self._name}: stopped"

    def state(self) -> StreamState | None:
        """State of the latest stream; None if there was none."""
        job = self._job
        if job is None:
            return None
        return StreamState(self._name, not self._over, job.share, self._message, self._failed)

    def close(self) -> None:
        """Stop the running stream, and wait shortly for its end."""
        self.stop()
        if self._job is not None:
            self._job.wait(CLOSE_WITHIN_S)

    def _remark(self, message: str) -> None:
        if not self._over:
            self._message = message

    def _done(self, _: None) -> None:
        self._message = f"{self._name}: all of it was sent"
        self._over = True  # last: who sees that it is over reads how it ended

    def _lost(self, error: Exception) -> None:
        if not isinstance(error, RallyscopeError):
            logger.error("a stream to the viewer failed", exc_info=error)
        self._failed, self._message = True, str(error) or "it failed; the log says why"
        self._over = True
