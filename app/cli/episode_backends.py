"""Where a training plays its balls: in the closed-form simulator, before event cameras, or in a simulation server."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from core.learning.config import RunConfig
from core.learning.task.episode_backend import EpisodeBackend


@contextlib.contextmanager
def open_backend(config: RunConfig, source: str | None) -> Iterator[EpisodeBackend | None]:
    """The court that a run needs, until the block ends; None for the closed-form simulator.

    Raises:
        LinkError: if there is no server at `source`, or it cannot give what the run asks for.
    """
    if source is not None:
        from core.rally.link.episode_backend import (
            LinkBackend,  # late: the chain and its compiled loops are for those who ask
        )

        backend = LinkBackend(config.environment, source)
    elif config.environment.state_source == "events":
        from core.rally.simulated.event_environment import EventCameraBackend

        backend = EventCameraBackend(config.environment, seed=config.first_seed)
    else:
        yield None
        return
    with contextlib.closing(backend):
        yield backend
