"""A paused simulation is stepped as fast as a player follows it: what comes of it does not depend on the machine."""

from core.live.link.client import SimulationClient
from core.live.live_player import LivePlayer
from tests.waiting import eventually


def play_block(client: SimulationClient, player: LivePlayer) -> None:
    """Step by one block, and wait until it has been played and the racket knows where to go."""
    t_us = client.step(1).t_us
    eventually(
        lambda: player.snapshot.t_us > t_us and player.idle, "the player to follow the block", lambda: player.snapshot
    )
