"""A server at tcp:// that has cameras and no robot: nobody aims its racket, and a robot of one's own may play."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
import zmq

from core.errors import LinkError
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.robot import RobotClient, SourceWithRobot
from tests.waiting import PATIENCE_S


@pytest.fixture(params=[False, True])
def served(request: pytest.FixtureRequest) -> Iterator[tuple[str, bool]]:
    """A server that only answers to hello, and says whether it has a robot."""
    context, ended = zmq.Context(), threading.Event()
    published, commands = context.socket(zmq.XPUB), context.socket(zmq.ROUTER)
    for _ in range(50):
        port = published.bind_to_random_port("tcp://127.0.0.1")
        try:
            commands.bind(f"tcp://127.0.0.1:{port + 1}")
            break
        except zmq.ZMQError:
            published.unbind(f"tcp://127.0.0.1:{port}")

    def serve() -> None:
        while not ended.is_set():
            if commands.poll(20):
                *envelope, data = commands.recv_multipart()
                number = m.decode(data, m.COMMANDS).id
                reply = m.Reply(id=number, ok=True, session="s", t_us=0, block_us=10_000, robot=request.param)
                commands.send_multipart([*envelope, m.encode(reply)])

    thread = threading.Thread(target=serve)
    thread.start()
    yield f"tcp://127.0.0.1:{port}", request.param
    ended.set()
    thread.join(PATIENCE_S)
    context.destroy(linger=0)


def test_it_has_the_robot_that_it_says_it_has(served: tuple[str, bool]) -> None:
    address, has_robot = served
    client, robot = SimulationClient(address), RobotClient("tcp://127.0.0.1:1")
    try:
        assert (client.robot is client) == has_robot and (client.robot is None) != has_robot
        if has_robot:
            with pytest.raises(LinkError, match="a robot of its own"):
                SourceWithRobot(client, robot)
        else:
            assert SourceWithRobot(client, robot).robot is not None
    finally:
        robot.close()
        client.close()
