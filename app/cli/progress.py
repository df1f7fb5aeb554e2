"""Progress on standard error: a bar in a terminal, a line now and then where none is."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from tqdm import tqdm

from app.cli.terminal import say
from app.formatting import percent
from core.text import plain

QUIET_S: Final = 5.0
"""What is done sooner says nothing where no bar can be drawn."""
SAY_EVERY_S: Final = 20.0


class Progress:
    """Called with the share of the work that is done, 0..1; `say` puts a line above the bar."""

    def __init__(self, show: Callable[[float], None], say: Callable[[str], None]) -> None:
        self._show, self._say = show, say

    def __call__(self, share: float) -> None:
        self._show(share)

    def say(self, line: str) -> None:
        """A line that stays."""
        self._say(line)


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A bar that the yielded object moves; where there is no terminal, lines with the share and the time left."""
    title = plain(title)
    if not sys.stderr.isatty():
        lines = _Lines(title)
        try:
            yield Progress(lines.show, _say_line)
        finally:
            lines.stop()
        return
    with tqdm(
        total=100,
        desc=title,
        unit="%",
        file=sys.stderr,
        leave=False,
        bar_format="{desc} {bar} {percentage:3.0f}% {remaining} left",
    ) as bar:

        def show(share: float) -> None:
            bar.update(min(100.0, 100.0 * share) - bar.n)

        yield Progress(show, lambda line: bar.write(plain(line, None), file=sys.stderr))


class _Lines:
    """Says how far the work is, from a thread: a step may take minutes."""

    def __init__(self, title: str) -> None:
        self._title, self._share, self._began_s = title, 0.0, time.monotonic()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="progress", daemon=True)
        self._thread.start()

    def show(self, share: float) -> None:
        self._share = min(1.0, share)

    def stop(self) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        wait_s = QUIET_S
        while not self._over.wait(wait_s):
            wait_s = SAY_EVERY_S
            _say_line(progress_line(self._title, self._share, time.monotonic() - self._began_s))


def progress_line(title: str, share: float, spent_s: float) -> str:
    """Such as "Measuring simulation: 25 %, about 3 min left"."""
    if share <= 0:
        return f"{title}: {words_of_seconds(spent_s)} so far"
    return f"{title}: {percent(share)}, about {words_of_seconds(spent_s * (1 - share) / share)} left"


def words_of_seconds(seconds: float) -> str:
    """A duration as a person says it."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _say_line(line: str) -> None:
    say(line, error=True)
