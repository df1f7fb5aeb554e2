"""Training in a simulation server."""

from __future__ import annotations

import pytest

from core.cameras import stereo_preset
from core.errors import LinkError
from core.events import SensorSize
from core.learning.config import environment_profile
from core.live.link.server import ServerConfig, SimulationServer
from core.live.link.server_backends import ServerEpisodes
from tests.simulation_servers import serving


def test_a_training_for_another_physics_than_the_server_s_is_refused() -> None:
    server = SimulationServer(ServerConfig(), stereo_preset("side", SensorSize(64, 48)), "tcp://127.0.0.1:0")
    with serving(server):
        with pytest.raises(LinkError, match="--physics"):
            ServerEpisodes(environment_profile("real", state_source="truth"), server.address)
        ServerEpisodes(environment_profile("paper", state_source="truth"), server.address).close()
