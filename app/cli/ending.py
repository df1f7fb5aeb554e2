"""The end of a verb that runs until it is told to stop."""

from __future__ import annotations

import functools
import select
import signal
import socket
import time


class EndRequest:
    """Whether a verb was asked to end.

    The system hands a signal to any thread, but Python handles it in the main thread, which no signal of another thread
    wakes from a lock (CPython's documentation of `signal.set_wakeup_fd`). So the main thread waits for the byte that a
    signal writes wherever it arrives; and the handler takes no lock, which the main thread could hold at that moment.
    """

    def __init__(self) -> None:
        self._asked = False
        self._woken, wakes = _wake_sockets()
        for name in (signal.SIGINT, signal.SIGTERM):
            signal.signal(name, self._ask)
        signal.set_wakeup_fd(wakes.fileno(), warn_on_full_buffer=False)

    def is_set(self) -> bool:
        """Whether it was asked. From any thread."""
        return self._asked

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait in the main thread until it is asked, at most so long; whether it was asked."""
        until_s = None if timeout_s is None else time.monotonic() + timeout_s
        while not self._asked:
            left_s = None if until_s is None else max(0.0, until_s - time.monotonic())
            if not select.select([self._woken], [], [], left_s)[0]:
                break
            self._woken.recv(4096)  # its handler runs before the next look; it may be that of another signal
        return self._asked

    def _ask(self, *_: object) -> None:
        self._asked = True


def end_event() -> EndRequest:
    """Set by Ctrl-C and by a polite kill, which from now on end nothing themselves. For the main thread."""
    return EndRequest()


@functools.cache
def _wake_sockets() -> tuple[socket.socket, socket.socket]:
    """What signals are read from, and what they write to; never closed, for a signal may come at any time."""
    woken, wakes = socket.socketpair()
    for end in (woken, wakes):
        end.setblocking(False)
    return woken, wakes
