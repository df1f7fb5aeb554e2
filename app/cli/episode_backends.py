"""Where a training plays its balls: in the closed-form simulator, before event cameras, or in a simulation server."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from core.errors import CommandError
from core.learning.config import RunConfig
from core.learning.task.environment import EpisodeBackend


@contextlib.contextmanager
def open_backend(config: RunConfig, source: str | None, keys: Path | None = None) -> Iterator[EpisodeBackend | None]:
    """The backend that a run needs, until the block ends; None for the closed-form simulator.

    Raises:
        CommandError: if there are keys and no source that could ask for them, or a source that cannot play balls of
            differing worlds.
        LinkError: if there is no server at `source`, it does not take `keys`, or it cannot give what the run asks for.
    """
    if source is None and keys is not None:
        raise CommandError("keys without a source", expected="--source tcp://HOST:PORT", where="--keys")
    if source is not None and (names := config.environment.randomise.names):
        raise CommandError("a server plays in one world", got=", ".join(names), remedy="leave out --randomise")
    if config.environment.outcomes == "events":
        backend = _perceived_backend(config, source, keys)
    elif source is not None:
        # late: the chain and its compiled loops are for those who ask
        from core.live.link.guard import read_client_keys
        from core.live.link.server_backends import ServerEpisodes

        backend = ServerEpisodes(config.environment, source, None if keys is None else read_client_keys(keys))
    elif config.environment.state_source == "events":
        from core.live.worlds.event_environment import EventCameraBackend

        backend = EventCameraBackend(config.environment, seed=config.first_seed)
    else:
        yield None
        return
    with contextlib.closing(backend):
        yield backend


def _perceived_backend(config: RunConfig, source: str | None, keys: Path | None) -> EpisodeBackend:
    """A backend of which only events are known: that of a server, or one simulated here."""
    from core.outcomes.perceived_backend import PerceivedBackend  # late: the chain and its compiled loops

    if source is not None:
        from core.live.link.guard import read_client_keys
        from core.live.link.server_backends import ServerWorld

        world_backend = ServerWorld(source, None if keys is None else read_client_keys(keys))
    else:
        from core.live.worlds.simulated_backend import SimulatedBackend

        world_backend = SimulatedBackend(config.environment.task, seed=config.first_seed)
    return PerceivedBackend(config.environment, world_backend)
