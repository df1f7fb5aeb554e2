"""A server that is not ready says so, and when it is ready nothing is left to compile."""

from __future__ import annotations

import threading

import pytest
import zmq
from numba.core import event

from core.cameras import stereo_preset
from core.errors import LinkError
from core.events import SensorSize
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.live.link.server import PreparingResponder, ServerConfig, SimulationServer, prepare_simulation
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.physics.task import task_profile
from core.simulation.episodes.mujoco_rally import MujocoRally
from core.simulation.episodes.racket import RacketTarget
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually


@pytest.mark.parametrize("physics", ["paper", "real"])
def test_after_it_a_rally_compiles_nothing(physics) -> None:
    config = WorldConfig(task=task_profile(physics))
    prepare_simulation(config, stereo_preset())
    compiled = event.RecordingListener()
    with event.install_listener("numba:compile", compiled):
        world = SimulatedWorld(config, stereo_preset("side", SensorSize(320, 240)), seed=1)
        world.draw_serve(5.0)
        kinds: set[str] = set()
        while not kinds >= {"bounce", "hit"} and world.now_us < 2_000_000:
            if world.now_us == 100_000:
                aim_at_flight(world)
            kinds |= {contact.event.kind for contact in world.advance().contacts}
        for _ in range(50):
            world.advance()
        world.close()
    assert kinds >= {"bounce", "hit"}
    assert not compiled.buffer


def aim_at_flight(world: SimulatedWorld) -> None:
    """Let another rally with the same ball tell where and when it comes to the racket's plane."""
    ahead = MujocoRally(world.config.task, dt_s=0.002)
    ball = world.rally.ball
    ahead.serve(ball[:3], ball[3:6], ball[6:9])
    began_s = world.rally.time_s
    while True:
        for happened in ahead.step():
            if happened.kind == "hit_plane":
                q = world.rally.racket.q_wxyz
                target = RacketTarget(happened.state[:3].copy(), q.copy(), (0.5, 0.0, 0.0), began_s + happened.t_s)
                world.aim(target)
                return


def test_a_server_that_compiles_answers_and_the_client_waits_for_it() -> None:
    context = zmq.Context()
    commands = context.socket(zmq.ROUTER)
    port = commands.bind_to_random_port("tcp://127.0.0.1")
    responder = PreparingResponder(commands)
    shares: list[float] = []
    answered, over = threading.Event(), threading.Event()

    def become_ready() -> None:
        answered.wait(PATIENCE_S)
        responder.stop()
        while not over.is_set():  # whoever is not answered in time asks again
            if commands.poll(20):
                who, data = commands.recv_multipart()
                number = m.decode(data, m.COMMANDS).id
                commands.send_multipart([who, m.encode(reply(number))])

    def told(share: float) -> None:
        shares.append(share)
        if len(shares) == 2:
            answered.set()

    thread = threading.Thread(target=become_ready)
    thread.start()
    client = SimulationClient(f"tcp://127.0.0.1:{port - 1}", preparing=told)
    try:
        assert client.welcome.session == "ready"
        assert len(shares) >= 2 and all(0 <= share <= 1 for share in shares)
    finally:
        over.set()
        thread.join(PATIENCE_S)
        client.close()
        context.destroy(linger=0)


def reply(number: int) -> m.Reply:
    return m.Reply(id=number, ok=True, session="ready", t_us=0, block_us=10_000, seed=0, cameras=())


def test_a_server_that_listens_but_is_slow_to_answer_is_waited_for() -> None:
    context = zmq.Context()
    commands = context.socket(zmq.ROUTER)
    port = commands.bind_to_random_port("tcp://127.0.0.1")

    over = threading.Event()

    def answer_late() -> None:
        asked = 0
        while not over.is_set():
            if commands.poll(20):
                who, data = commands.recv_multipart()
                asked += 1
                if asked > 3:  # those before have been given up
                    commands.send_multipart([who, m.encode(reply(m.decode(data, m.COMMANDS).id))])

    thread = threading.Thread(target=answer_late)
    thread.start()
    client = SimulationClient(f"tcp://127.0.0.1:{port - 1}", timeout_s=0.2)
    assert client.welcome.session == "ready"
    client.close()
    over.set()
    thread.join(PATIENCE_S)
    context.destroy(linger=0)


def test_commands_to_a_server_that_is_being_prepared_are_refused_in_words() -> None:
    told: list[tuple[int, int]] = []
    server = SimulationServer(
        ServerConfig(), stereo_preset("side", SensorSize(64, 48)), "tcp://127.0.0.1:0",
        preparing=lambda ready, known: told.append((ready, known)),
    )  # fmt: skip
    host, port = server.address.removeprefix("tcp://").split(":")
    context = zmq.Context()
    asking = context.socket(zmq.REQ)
    asking.connect(f"tcp://{host}:{int(port) + 1}")
    asking.send(m.encode(m.Serve(id=7, speed_mps=5.0)))
    answer = m.decode(asking.recv(), {"reply": m.Reply})
    assert (answer.id, answer.ok) == (7, False) and "being prepared" in answer.error
    assert answer.preparing is not None
    asking.send(b"garbage")
    assert m.decode(asking.recv(), {"reply": m.Reply}).id == 0
    server.prepare()
    eventually(lambda: told, "word of the kernels")  # the thread that answers looks ten times a second
    assert all(0 < ready <= known for ready, known in told)
    with serving(server):
        client = SimulationClient(server.address, timeout_s=PATIENCE_S)
        with pytest.raises(LinkError, match="out of bounds"):
            client.ask(lambda number: m.SetSpeed(id=number, factor=-1.0))
        assert client.serve().ok
        client.close()
    context.destroy(linger=0)
