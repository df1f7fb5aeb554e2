"""A server with keys, on loopback: the right key plays; all others get nothing, and are told so after a while."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import zmq

from core.cameras.presets import stereo_preset
from core.errors import LinkError, RefusedError
from core.events import SensorSize
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.live.link.guard import ClientKeys, LinkGateway, make_keys, read_client_keys, read_server_keys, secure
from core.live.link.server import ServerConfig, SimulationServer
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually


class Guarded(NamedTuple):
    address: str
    ours: ClientKeys
    folder: Path


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    folder = tmp_path_factory.mktemp("keys")
    server_folder, client_folder = make_keys(folder)
    cameras = stereo_preset("side", SensorSize(64, 48))
    server = SimulationServer(ServerConfig(), cameras, "tcp://127.0.0.1:0", keys=read_server_keys(server_folder))
    server.prepare()
    with serving(server):
        yield Guarded(server.address, read_client_keys(client_folder), folder)


def _send_at_once(socket: zmq.Socket, message: bytes) -> None:
    """Send, unless the socket was sent away before: it has no pipe then, and a waiting send would never end."""
    with contextlib.suppress(zmq.Again):
        socket.send(message, zmq.DONTWAIT)


def test_the_right_key_commands_and_hears(guarded: Guarded) -> None:
    client = SimulationClient(guarded.address, keys=guarded.ours, timeout_s=PATIENCE_S)
    try:
        assert client.serve().ok
        eventually(lambda: client.state is not None and client.state.served >= 1, "a block after the serve")
    finally:
        client.close()


def test_an_unknown_key_is_told_that_it_does_not_fit(guarded: Guarded, tmp_path: Path) -> None:
    _, elsewhere = make_keys(tmp_path)
    stranger = ClientKeys(read_client_keys(elsewhere).own, guarded.ours.server)
    with pytest.raises(RefusedError, match="its keys and ours do not fit"):
        SimulationClient(guarded.address, keys=stranger, timeout_s=2.0)


@pytest.mark.parametrize("with_key", [True, False])
def test_who_is_refused_before_he_has_asked_does_not_wait_for_ever(
    with_key: bool, guarded: Guarded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connect = zmq.Socket.connect

    def connect_slowly(socket: zmq.Socket, address: str) -> None:
        connect(socket, address)
        if address.startswith("tcp") and socket.type == zmq.DEALER:
            eventually(lambda: not socket.poll(0, zmq.POLLOUT), "the refusal")

    _, elsewhere = make_keys(tmp_path)
    stranger = ClientKeys(read_client_keys(elsewhere).own, guarded.ours.server)
    monkeypatch.setattr(zmq.Socket, "connect", connect_slowly)
    with pytest.raises(RefusedError, match="its keys and ours do not fit"):
        SimulationClient(guarded.address, keys=stranger if with_key else None, timeout_s=2.0)


def test_a_server_with_another_key_than_the_known_one_is_not_talked_to(guarded: Guarded, tmp_path: Path) -> None:
    _, elsewhere = make_keys(tmp_path)
    mistaken = ClientKeys(guarded.ours.own, read_client_keys(elsewhere).server)
    with pytest.raises(RefusedError, match="do not fit"):
        SimulationClient(guarded.address, keys=mistaken, timeout_s=2.0)


def test_no_key_is_told_so(guarded: Guarded) -> None:
    with pytest.raises(RefusedError, match="--make-keys"):
        SimulationClient(guarded.address, timeout_s=2.0)


@pytest.mark.gate
def test_without_the_right_key_nothing_is_published_and_no_command_is_taken(guarded: Guarded, tmp_path: Path) -> None:
    _, elsewhere = make_keys(tmp_path)
    stranger = ClientKeys(read_client_keys(elsewhere).own, guarded.ours.server)
    playing = SimulationClient(guarded.address, keys=guarded.ours, timeout_s=PATIENCE_S)
    host, _, port = guarded.address.rpartition(":")
    with zmq.Context() as context:
        for keys in (None, stranger):
            with context.socket(zmq.SUB) as heard, context.socket(zmq.DEALER) as asked:
                monitors = [socket.get_monitor_socket(zmq.EVENT_DISCONNECTED) for socket in (heard, asked)]
                for socket in (heard, asked):
                    socket.setsockopt(zmq.LINGER, 0)
                    secure(socket, keys)
                heard.subscribe(b"")
                heard.connect(guarded.address)
                asked.connect(f"{host}:{int(port) + 1}")
                _send_at_once(asked, m.encode(m.Reset(id=1, seed=99)))
                assert all(monitor.poll(1e3 * PATIENCE_S) for monitor in monitors), "both are sent away"
                before_us = playing.ask(lambda number: m.Hello(id=number)).t_us
                eventually(lambda: playing.state and playing.state.t_us > before_us + 300_000, "30 blocks for others")  # noqa: B023
                assert not heard.poll(0) and not asked.poll(0)
                for socket, monitor in zip((heard, asked), monitors, strict=True):
                    socket.disable_monitor()
                    monitor.close(0)
    assert playing.ask(lambda number: m.Hello(id=number)).seed == playing.welcome.seed != 99
    playing.close()


def test_a_door_that_is_closed_lets_nobody_in(tmp_path: Path) -> None:
    server_folder, client_folder = make_keys(tmp_path)
    with zmq.Context() as context, zmq.Context() as elsewhere:
        door = LinkGateway(context, read_server_keys(server_folder))
        with context.socket(zmq.ROUTER) as commands, elsewhere.socket(zmq.DEALER) as asked:
            door.guard(commands)
            port = commands.bind_to_random_port("tcp://127.0.0.1")
            door.close()
            asked.setsockopt(zmq.LINGER, 0)
            monitor = asked.get_monitor_socket(zmq.EVENT_DISCONNECTED)
            secure(asked, read_client_keys(client_folder))
            asked.setsockopt(zmq.HANDSHAKE_IVL, 1000)
            asked.connect(f"tcp://127.0.0.1:{port}")
            _send_at_once(asked, b"anybody there?")
            assert monitor.poll(1e3 * PATIENCE_S), "its handshake ends"
            assert not commands.poll(0)
            asked.disable_monitor()
            monitor.close(0)


def test_beyond_this_machine_neither_side_begins_without_keys() -> None:
    cameras = stereo_preset("side", SensorSize(64, 48))
    with pytest.raises(LinkError, match="expected --keys DIR"):
        SimulationServer(ServerConfig(), cameras, "tcp://0.0.0.0:0")
    with pytest.raises(LinkError, match="expected --keys DIR"):
        SimulationClient("tcp://192.0.2.1:5555")


def test_a_sender_of_more_than_a_command_is_cut_off_from_what_is_published(guarded: Guarded) -> None:
    with zmq.Context() as context, context.socket(zmq.SUB) as heard:
        heard.setsockopt(zmq.LINGER, 0)
        secure(heard, guarded.ours)
        gone = heard.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        heard.subscribe(b"x" * (m.COMMAND_BYTES + 1000))
        heard.connect(guarded.address)
        assert gone.poll(1e3 * PATIENCE_S)
        heard.disable_monitor()
        gone.close(0)
    client = SimulationClient(guarded.address, keys=guarded.ours)  # and lives
    client.close()
