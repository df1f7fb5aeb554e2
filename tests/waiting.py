"""Waiting for a state, never for a time: how long something takes is for a benchmark to say."""

import os
import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 100.0 * float(os.environ.get("RALLYSCOPE_TEST_PATIENCE", "1"))
"""How long a test waits before it fails. RALLYSCOPE_TEST_PATIENCE stretches it on a machine that does other things."""
PAUSE_S = 0.01
"""Between two looks: short beside all that is waited for, long beside a look."""

Seen = TypeVar("Seen")


def eventually(condition: Callable[[], Seen], what: str, seen: Callable[[], object] | None = None) -> Seen:
    """First true value of a condition.

    Args:
        condition: Asked again and again; an exception of its own ends the waiting, as when a process has died.
        what: What is waited for, named when it does not come.
        seen: Tells how things stand instead, for the message; by default the condition's last value is shown.

    Raises:
        AssertionError: The condition did not become true within `PATIENCE_S`.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        if time.monotonic() > deadline_s:
            state = found if seen is None else seen()
            raise AssertionError(f"waited {PATIENCE_S:g} s in vain for {what}; seen last: {state!r}")
        time.sleep(PAUSE_S)
    return found
