"""Excludes loaded objects from garbage collection, so that full collections are short.

A look through all of it takes a quarter of a second in which no thread does anything: the live rally stands still, and
its commands are late (of 45 s of a rally two such looks, 256 and 298 ms).
"""

from __future__ import annotations

import gc
from typing import Final

AFTER_S: Final = (5.0, 30.0, 120.0)
"""Times after the first browser connected; by then scene, chain and the modules of Watch are loaded."""


class GcFreeze:
    """Freezes existing objects a few times after the app's start; garbage at that moment is never freed."""

    def __init__(self) -> None:
        self._begun_s: float | None = None
        self._done = 0

    def tick(self, wall_s: float, *, busy: bool) -> None:
        """`busy`: a browser is connected."""
        if self._begun_s is None and busy:
            self._begun_s = wall_s
        if self._begun_s is None or self._done == len(AFTER_S) or wall_s - self._begun_s < AFTER_S[self._done]:
            return
        self._done += 1
        gc.freeze()
