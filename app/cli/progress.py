"""A progress bar on standard error, quiet where nobody watches."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

Progress = Callable[[float], None]
"""Called with the share of the work that is done, 0..1."""


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A bar that the yielded function moves; nothing is drawn when standard error is not a terminal."""
    with tqdm(
        total=100,
        desc=title,
        unit="%",
        file=sys.stderr,
        disable=None,
        leave=False,
        bar_format="{desc} {bar} {percentage:3.0f}% {remaining} left",
    ) as bar:

        def show(share: float) -> None:
            bar.update(min(100.0, 100.0 * share) - bar.n)

        yield show
