"""The end of a verb that runs until it is told to stop."""

from __future__ import annotations

import signal
import threading


def end_event() -> threading.Event:
    """Set by Ctrl-C and by a polite kill, which from now on end nothing themselves."""
    ended = threading.Event()
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda *_: ended.set())
    return ended
