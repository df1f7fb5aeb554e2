"""Where a training plays its balls: in the closed-form simulator, before event cameras, or in a simulation server."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from core.learning.config import RunConfig
from core.learning.court import Court


@contextlib.contextmanager
def open_court(config: RunConfig, source: str | None) -> Iterator[Court | None]:
    """The court that a run needs, until the block ends; None for the closed-form simulator.

    Raises:
        LinkError: if there is no server at `source`, or it cannot give what the run asks for.
    """
    if source is not None:
        from core.rally.link.court import LinkCourt  # late: the chain and its compiled loops are for those who ask

        court = LinkCourt(config.environment, source)
    elif config.environment.state_source == "events":
        from core.rally.event_environment import EventCourt

        court = EventCourt(config.environment, seed=config.first_seed)
    else:
        yield None
        return
    with contextlib.closing(court):
        yield court
