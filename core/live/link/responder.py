"""Replies for a server that is not ready yet, with its progress."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final

import zmq

from core.errors import LinkError
from core.jit import kernels_ready
from core.live.link import messages as m
from core.simulation.event_cameras.event_camera import BLOCK_US

logger = logging.getLogger(__name__)
LOOK_EVERY_MS: Final = 100
COMPILED: Final = ("core.physics", "core.simulation")
"""Packages with nearly all kernels of a simulation."""
KernelProgress = Callable[[int, int], None]
"""Called with the kernels that are ready and those that there are, whenever more are ready."""


class PreparingResponder:
    """Answers every command with "preparing" on a thread of its own, which alone uses the socket until `stop`."""

    def __init__(self, commands: zmq.Socket, on_progress: KernelProgress = lambda ready, known: None) -> None:
        """`commands` is the bound ROUTER socket."""
        self._commands, self._on_progress = commands, on_progress
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="preparing", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Release the socket; may be called again."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        reported = 0
        while not self._ended.is_set():
            ready, known = kernels_ready(*COMPILED)
            if ready > reported:
                reported = ready
                self._on_progress(ready, known)
            if self._commands.poll(LOOK_EVERY_MS):
                *envelope, data = self._commands.recv_multipart()
                self._commands.send_multipart([*envelope, m.encode(_reply(data, ready, known))], zmq.NOBLOCK)


def _reply(data: bytes, ready: int, known: int) -> m.Reply:
    try:
        number = m.decode(data, m.COMMANDS, m.COMMAND_BYTES).id
    except LinkError as error:
        logger.debug("ignored: %s", error)
        number = 0
    share = min(1.0, ready / known) if known else 0.0
    error = f"the simulation is being prepared: {ready} of about {known} kernels are ready"
    return m.Reply(
        id=number, ok=False, error=error, session="", t_us=0, block_us=BLOCK_US, seed=0, cameras=(), preparing=share
    )
