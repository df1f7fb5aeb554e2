"""A court over the link: the server's events alone say what came of a stroke."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.errors import LinkError
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import evaluation_balls, play
from core.live.link.client import SimulationClient
from core.live.link.server import ServerConfig, SimulationServer
from core.live.link.server_backends import ServerWorld
from core.outcomes.perceived_backend import PerceivedBackend
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually

EVENTS = EnvironmentConfig(state_source="events", outcomes="events")


@pytest.fixture
def server() -> Iterator[SimulationServer]:
    with serving(SimulationServer(ServerConfig(), stereo_preset(), "tcp://127.0.0.1:0")) as server:
        yield server


@pytest.mark.gate
def test_a_stroke_in_a_server_is_judged_by_its_events(
    server: SimulationServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("core.live.link.server_backends.PATIENCE_S", PATIENCE_S)
    backend = PerceivedBackend(EVENTS, ServerWorld(server.address))
    try:
        truth = evaluation_balls(6.0, 1, EVENTS)
        ball = backend.observe(truth)
        outcome = backend.play(ball, np.zeros((1, 3)))
    finally:
        backend.close()
    assert ball.seen[0] and backend.serve_seen is not None and ball.aim_t_s is not None
    early_s = (backend.served_us - backend.serve_seen.t_us) * 1e-6
    ball.aim_t_s[0] -= early_s
    expected = play(ball, np.zeros((1, 3)), EVENTS)
    assert outcome.case[0] == expected.case[0]
    np.testing.assert_allclose(outcome.landings_m, expected.landings_m, atol=0.02)


def test_the_first_block_is_heard_however_late_the_subscription_is(
    server: SimulationServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("core.live.link.server_backends.PATIENCE_S", PATIENCE_S)
    receive = SimulationClient._receive

    def receive_late(client: SimulationClient) -> None:
        eventually(lambda: server._commanded_s > 0, "the client's first command")
        receive(client)

    monkeypatch.setattr(SimulationClient, "_receive", receive_late)
    world_backend = ServerWorld(server.address)
    try:
        assert world_backend.advance().events.keys() == world_backend.cameras.keys()
    finally:
        world_backend.close()


def test_a_court_that_began_anew_says_so(server: SimulationServer, monkeypatch: pytest.MonkeyPatch) -> None:
    world_backend = ServerWorld(server.address)
    try:
        first = world_backend.advance()
        monkeypatch.setattr("core.live.link.server_backends.PATIENCE_S", 2.0)
        assert first.events.keys() == world_backend.cameras.keys() and world_backend.now_us == first.end_us
        world_backend._client.reset(5)
        with pytest.raises(LinkError, match="no events of a block"):
            world_backend.advance()
    finally:
        world_backend.close()
