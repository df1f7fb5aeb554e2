"""Whether this process is compiling a kernel now, from numba's own events."""

from __future__ import annotations

import threading
from typing import Final

from numba.core import event


class CompileCounter(event.Listener):
    """Counts the compilations that run; a kernel that is loaded from the cache is none."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.running = 0

    def on_start(self, event: event.Event) -> None:
        """Count a compilation that begins, in any thread."""
        with self._lock:
            self.running += 1

    def on_end(self, event: event.Event) -> None:
        """Count a compilation that has ended, well or not."""
        with self._lock:
            self.running -= 1


_COUNTER: Final = CompileCounter()
event.register("numba:compile", _COUNTER)


def is_compiling() -> bool:
    """Whether a kernel is being compiled, which takes seconds instead of milliseconds."""
    return _COUNTER.running > 0
