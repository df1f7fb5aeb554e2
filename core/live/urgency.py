"""What lets the threads between camera and robot go first: in the interpreter, and where the system allows it; and
what keeps the garbage collector from stopping them.

They compute a millisecond in ten, but share the interpreter with pictures and pages. A thread that comes back from
compiled code or a wait asks for the interpreter, and gets it only when its holder's turn is over.
"""

from __future__ import annotations

import functools
import gc
import logging
import os
import sys
import threading
from typing import Final

logger = logging.getLogger(__name__)

TURN_S: Final = 5e-4
"""Longest turn of a thread in the interpreter, s. Python's own is 5 ms; a chain step asks about ten times."""
NICENESS: Final = -10
"""Priority of urgent threads, where allowed: before pages and pictures, behind the system's own."""


def shorten_turns() -> None:
    """Let waiting threads of this process have the interpreter after `TURN_S`."""
    sys.setswitchinterval(TURN_S)


@functools.cache  # once in a process: what is garbage later, such as a rally that was closed, must be freed
def freeze_loaded() -> None:
    """Keep the garbage collector from what is loaded by now: a look through it stops all threads for 0.1 s or more."""
    gc.collect()
    gc.freeze()


def go_first(niceness: int = NICENESS) -> bool:
    """Give the calling thread that priority; False where the system has none for threads, or does not allow it.

    Threads and processes that it starts have normal priority.
    """
    if sys.platform != "linux":  # elsewhere the number of a thread is none of a process
        return False
    thread = threading.get_native_id()
    try:
        # Otherwise they inherit it: OpenCV's threads, which the first picture's computation starts for all pictures.
        os.sched_setscheduler(thread, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, thread, niceness)
    except OSError as error:
        logger.debug("no priority for %s: %s", threading.current_thread().name, error)
        return False
    return True
