"""What viser says on the terminal by itself, for verbs that start a server to silence: it is the whole process's."""

from __future__ import annotations

import warnings


def silence_viser() -> None:
    """No banner where it listens, no line when it stops, no news of a browser that closed with a picture on its way.

    viser 1.1 has no switch for its banner and its last line; both go through rich, which nothing else here uses.
    """
    import rich

    rich.get_console().quiet = True
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection", category=UserWarning)
