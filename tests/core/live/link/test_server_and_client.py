"""A real server process: served balls arrive, faults are survived."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgpack
import numpy as np
import pytest
import zmq

from core.cameras import stereo_preset
from core.errors import LinkError, NoAnswerError
from core.events import SensorSize
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.live.link.server import HEARTBEAT_S, ServerConfig, SimulationServer
from core.live.worlds.world import Block
from core.physics.config import physics_profile
from core.physics.episode import Case
from tests.ports import lasting_address
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually


def start(bind: str = "tcp://127.0.0.1:0", *more: str) -> tuple[subprocess.Popen, str]:
    command = [sys.executable, "-c", "from app.cli import main; main()", "sim-server", "--bind", bind]
    process = subprocess.Popen(
        [*command, "--sensor", "320x240", "--seed", "3", *more], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    assert "tcp://" in line, line
    return process, line.split()[4]


@pytest.fixture(scope="module")
def address():
    process, where = start()
    yield where
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0


@pytest.fixture
def client(address):
    """A client that hears the server: the subscription has arrived, and nothing of an earlier session is under way."""
    client = SimulationClient(address, timeout_s=PATIENCE_S)
    begun = client.reset().session
    client.set_speed(1.0)
    client.resume()
    eventually(lambda: client.state is not None and client.state.session == begun, "the first state of the session")
    yield client
    client.close()


class Ear:
    def __init__(self) -> None:
        self.welcomes, self.batches, self.states, self.notices = [], [], [], []

    def on_session(self, welcome):
        self.welcomes.append(welcome)

    def on_events(self, batch):
        self.batches.append(batch)

    def on_state(self, state):
        self.states.append(state)

    def on_notice(self, notice):
        self.notices.append(notice)


def outcomes(ear: Ear) -> list[m.OutcomeNotice]:
    return [notice for notice in ear.notices if isinstance(notice, m.OutcomeNotice)]


def step_until(condition: Callable[[], object], client: SimulationClient, ear: Ear) -> None:
    """Step a paused server, by no more blocks at once than the link keeps for a slow listener."""
    while not condition():
        t_us = client.step(10).t_us
        eventually(lambda: ear.states and ear.states[-1].t_us >= t_us + 100_000, "ten blocks")  # noqa: B023


class HandClock:
    """A clock that is moved by hand, and counts how often it was looked at."""

    def __init__(self) -> None:
        self.now_s, self.looks = 1000.0, 0

    def __call__(self) -> float:
        self.looks += 1
        return self.now_s

    def move(self, seconds: float) -> None:
        """Move it on, and wait until that was seen."""
        self.now_s += seconds
        looks = self.looks
        eventually(lambda: self.looks > looks + 20, "looks at the clock")


class SteadyClock(HandClock):
    """A clock that goes on by itself, but not while the machine stands still."""

    def __init__(self) -> None:
        super().__init__()
        self._seen_s = time.monotonic()

    def __call__(self) -> float:
        before_s, self._seen_s = self._seen_s, time.monotonic()
        self.now_s += min(self._seen_s - before_s, HEARTBEAT_S)
        return super().__call__()


class WatchedServer(SimulationServer):
    """Counts its turns and signs of life, and notes at which time of its clock it published each block."""

    turns = beats = 0

    def _turn(self) -> None:
        self.turns += 1
        super()._turn()

    def _send_alive(self) -> None:
        self.beats += 1
        super()._send_alive()

    def _start_session(self, seed: int) -> None:
        self.published: list[tuple[float, int]] = []
        super()._start_session(seed)

    def _publish(self, block: Block) -> None:
        self.published.append((self._clock(), block.end_us))
        super()._publish(block)


@contextmanager
def serving_balls(clock: HandClock | None = None) -> Iterator[WatchedServer]:
    """A server which serves a ball as soon as none flies."""
    config, cameras = ServerConfig(auto_serve_mps=5.0), stereo_preset("side", SensorSize(320, 240))
    settings = {} if clock is None else {"clock": clock}
    with serving(WatchedServer(config, cameras, "tcp://127.0.0.1:0", **settings)) as server:
        try:
            yield server
        finally:
            if clock is not None:
                clock.now_s += 3600.0  # no block waits for its time any more


def test_a_served_ball_is_seen_by_both_cameras_and_judged(client):
    ear = Ear()
    client.add_listener(ear)
    client.pause()
    client.launch((1.0, 0.5, 0.3), (-5.0, 0.0, 1.0))
    step_until(lambda: outcomes(ear), client, ear)
    (outcome,) = outcomes(ear)
    assert outcome.case is Case.MISSED  # it passes beside the resting racket
    assert outcome.speed_mps == pytest.approx(np.hypot(5, 1))
    bounce = next(notice for notice in ear.notices if isinstance(notice, m.BounceNotice))
    assert bounce.p_m[2] == pytest.approx(0.02) and bounce.v_mps[2] > 0
    fall_s = (1 + np.sqrt(1 + 2 * 9.81 * 0.28)) / 9.81
    assert bounce.t_us - outcome.serve_us == pytest.approx(1e6 * fall_s, abs=2)
    assert bounce.p_m[0] == pytest.approx(1 - 5 * fall_s, abs=1e-5)
    assert {batch.camera for batch in ear.batches} == {"left", "right"}
    rows = np.concatenate([state.ball for state in ear.states])
    visible = np.concatenate([state.ball_visible for state in ear.states]).astype(bool)
    assert visible.any() and np.isfinite(rows[visible]).all()
    assert 0.02 - 1e-6 < rows[visible][rows[visible][:, 0] > -1][:, 2].min() < 0.03  # it bounced on the table
    assert sum(len(batch.since_us) for batch in ear.batches) > 1000


def test_the_same_seed_gives_the_same_session_again(client):
    def session() -> list[bytes]:
        ear = Ear()
        client.pause()
        begun = client.reset(5).session
        client.add_listener(ear)
        client.serve(6.0)
        client.step(12)
        eventually(
            lambda: (begun, 120_000) in [(state.session, state.t_us) for state in ear.states], "the twelfth block"
        )
        client.remove_listener(ear)
        return [batch.x_px.tobytes() for batch in ear.batches if batch.session == begun]

    first = session()
    assert len(first) == 24
    assert session() == first


def test_pause_and_single_step(client):
    client.pause()
    ear = Ear()
    client.add_listener(ear)
    t_us = client.ask(lambda number: m.Hello(id=number)).t_us
    beats = len(ear.states)
    eventually(lambda: len(ear.states) > beats + 3, "signs of life of a paused server")
    assert client.ask(lambda number: m.Hello(id=number)).t_us == t_us
    eventually(lambda: client.status == "connected", "the next sign of life")
    client.step(3)
    eventually(lambda: ear.states and ear.states[-1].t_us == t_us + 30_000, "the third block")
    client.resume()
    eventually(lambda: ear.states[-1].t_us > t_us + 50_000, "it to run again")


@pytest.mark.parametrize(
    ("commands", "blocks"),
    [((m.Resume(id=1), m.Pause(id=2)), [0, 1, 1, 1]), ((m.SingleStep(id=1, blocks=5), m.Reset(id=2)), [0, 1, 0, 0])],
    ids=["a pause", "a reset while it is stepped"],
)
def test_no_block_is_begun_after_this_is_answered(commands, blocks):
    server = WatchedServer(ServerConfig(), stereo_preset("side", SensorSize(64, 48)), "tcp://127.0.0.1:0")
    host, port = server.address.rsplit(":", 1)
    with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(f"{host}:{int(port) + 1}")
        commands, blocks_before_turn = iter(commands), []

        def ended() -> bool:
            """Between two turns: the next command is there before the turn begins."""
            blocks_before_turn.append(len(server.published))
            if (command := next(commands, None)) is not None:
                socket.send(m.encode(command))
                assert server._commands.poll(1e3 * PATIENCE_S)
            return len(blocks_before_turn) == 4

        server.run(ended)
    assert blocks_before_turn == blocks


@pytest.mark.parametrize("speed", [1.0, 0.1])
def test_a_block_is_published_at_its_time_and_never_before_it(speed):
    clock = HandClock()
    with serving_balls(clock) as server:
        client = SimulationClient(server.address, timeout_s=PATIENCE_S)
        eventually(lambda: server.attended, "the subscription")
        client.set_speed(speed)
        eventually(lambda: server._world.now_us > server._anchor_us, "a block to be computed")
        since_s, since_us, before = clock.now_s, server._anchor_us, len(server.published)
        for _ in range(20):
            clock.move(0.005 / speed)
        published = server.published[before:]
        client.close()
    assert [end_us for _, end_us in published] == [since_us + 10_000 * (k + 1) for k in range(len(published))]
    late_s = [at_s - since_s - (end_us - since_us) * 1e-6 / speed for at_s, end_us in published]
    assert 9 <= len(published) <= 10 and min(late_s) > -1e-6 and max(late_s) < 0.005 / speed


def test_commands_out_of_bounds_are_refused_and_nothing_happens(client):
    with pytest.raises(LinkError, match="reach"):
        client.aim_racket((4.0, 0.0, 0.2), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 10**6)
    with pytest.raises(LinkError, match=r"speed_mps.*out of bounds"):
        client.serve(50.0)
    with pytest.raises(LinkError, match="factor"):
        client.set_speed(0.0)
    assert client.ask(lambda number: m.Hello(id=number)).ok


def test_garbage_is_answered_with_an_error_and_the_server_lives(address, client):
    rng = np.random.default_rng(2)
    host, port = address.rsplit(":", 1)
    with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.connect(f"{host}:{int(port) + 1}")
        for number in range(200):
            socket.send(rng.bytes(number * 7))
        socket.send(b"\0" * (m.COMMAND_BYTES + 1))
        socket.send(msgpack.packb({"v": 99, "kind": "hello", "id": 1}))
        replies = []
        for _ in range(202):
            assert socket.poll(1e3 * PATIENCE_S)
            replies.append(m.decode(socket.recv(), m.KINDS))
        assert not any(reply.ok for reply in replies)
        assert "another version" in replies[-1].error and "too long" in replies[-2].error
        cut_off = socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        socket.send(b"\0" * (32 * m.COMMAND_BYTES))
        assert cut_off.poll(1e3 * PATIENCE_S)
        socket.disable_monitor()
        cut_off.close(0)
    assert client.ask(lambda number: m.Hello(id=number)).ok


def test_a_server_of_another_version_is_refused_with_both_versions():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as socket:
        port, over = socket.bind_to_random_port("tcp://127.0.0.1"), threading.Event()

        def answer() -> None:
            while not over.is_set():  # whoever is not answered in time asks again
                if socket.poll(20):
                    who, _ = socket.recv_multipart()
                    socket.send_multipart([who, msgpack.packb({"v": 7, "kind": "reply"})])

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(LinkError, match="expected version 1, got 7"):
            SimulationClient(f"tcp://127.0.0.1:{port - 1}")
        over.set()
        thread.join(PATIENCE_S)


def test_no_server_is_one_clear_error():
    with pytest.raises(LinkError, match="rallyscope sim-server"):
        SimulationClient("tcp://127.0.0.1:9", timeout_s=0.2)


def test_the_scene_changes_between_two_blocks_and_stays_in_the_next_session(client):
    ear = Ear()
    client.pause()
    client.add_listener(ear)
    before = client.step(5).t_us + 50_000
    eventually(lambda: ear.states and ear.states[-1].t_us == before, "five blocks")
    assert ear.states[-1].scene == "ball"
    client.set_scene("head")
    client.step(10)
    eventually(lambda: ear.states[-1].t_us >= before + 100_000, "ten blocks")
    assert ear.states[-1].scene == "head"
    starts_us = [batch.start_us for batch in ear.batches if batch.camera == "left"]
    assert set(np.diff(starts_us)) == {10_000}
    client.reset()
    client.step(1)
    eventually(lambda: ear.states[-1].t_us == 10_000, "the first block of the new session")
    assert ear.states[-1].scene == "head"
    client.set_scene("ball")
    with pytest.raises(LinkError, match="no such choice"):
        client.set_scene("moon")


def test_a_subscriber_that_never_reads_is_not_waited_for_and_loses_messages(address, client):
    """Many times more is published than fits into its queues."""
    with zmq.Context() as context, context.socket(zmq.SUB) as slow:
        slow.setsockopt(zmq.RCVHWM, 1)
        slow.setsockopt(zmq.LINGER, 0)
        slow.connect(address)
        slow.subscribe(b"state")
        assert slow.poll(1e3 * PATIENCE_S)
        seq = m.decode(slow.recv_multipart()[1], m.KINDS).seq
        slow.subscribe(b"")
        client.set_noise(20.0)
        client.set_speed(100.0)  # as fast as it can
        t_us = client.ask(lambda number: m.Hello(id=number)).t_us
        eventually(lambda: client.state.t_us > t_us + 5_000_000, "500 blocks", lambda: client.state.t_us - t_us)
        client.set_noise(0.1)
        client.set_speed(1.0)

        def has_lost() -> bool:
            nonlocal seq
            before, seq = seq, m.decode(slow.recv_multipart()[1], m.KINDS).seq
            return seq > before + 100

        eventually(has_lost, "a gap in what it reads at last", lambda: seq)


def test_time_begins_with_the_first_client():
    clock = HandClock()
    with serving_balls(clock) as server:
        clock.move(60.0)
        client = SimulationClient(server.address, timeout_s=PATIENCE_S)
        assert client.welcome.t_us <= 10_000  # a block may be under way already
        client.close()


def test_time_begins_for_one_who_only_listens():
    with serving_balls() as server, zmq.Context() as context, context.socket(zmq.SUB) as listener:
        listener.setsockopt(zmq.RCVTIMEO, round(1e3 * PATIENCE_S))
        listener.connect(server.address)
        listener.subscribe(b"state")
        assert [m.decode(listener.recv_multipart()[1], m.KINDS).t_us for _ in range(3)][-1] >= 30_000


@pytest.fixture
def watched() -> Iterator[tuple[WatchedServer, SimulationClient, Ear]]:
    """A server, the only client of it, and what that one has heard. A command counts for some seconds of its clock."""
    with serving_balls(SteadyClock()) as server:
        client, ear = SimulationClient(server.address, timeout_s=PATIENCE_S), Ear()
        client.add_listener(ear)
        eventually(lambda: len(ear.states) > 10, "more than ten blocks")
        yield server, client, ear
        client.close()


def rest(server: WatchedServer, client: SimulationClient, ear: Ear) -> None:
    """Leave it alone until it stands still, and the client knows where."""
    client.listen(False)
    eventually(lambda: not server.attended, "the end of the subscription")
    heard, stands_us = len(ear.states), server._world.now_us

    def is_known() -> bool:
        return len(ear.states) > heard and ear.states[-1].t_us == stands_us and not ear.states[-1].ends_block

    eventually(is_known, "a sign of life at rest")


def assert_without_gap(ear: Ear) -> None:
    """Each block begins where the one before it ended, and has the events of both cameras."""
    blocks = [(state.start_us, state.t_us) for state in ear.states if state.ends_block]
    assert [start_us for start_us, _ in blocks[1:]] == [end_us for _, end_us in blocks[:-1]]
    first_us, last_us = blocks[0][0], blocks[-1][1]
    inside = [one.start_us for one in ear.batches if first_us <= one.start_us < last_us]
    assert sorted(inside) == sorted(2 * [start_us for start_us, _ in blocks])


class BusyEar(Ear):
    """An ear that takes its time for one block: what is published meanwhile waits in the client's queue."""

    def __init__(self) -> None:
        super().__init__()
        self.at_work, self.done = threading.Event(), threading.Event()

    def on_state(self, state):
        super().on_state(state)
        if not self.done.is_set():
            self.at_work.set()
            self.done.wait(PATIENCE_S)


def test_what_is_under_way_when_a_listener_leaves_still_comes(watched):
    server, client, ear = watched
    busy = BusyEar()
    client.add_listener(busy)
    assert busy.at_work.wait(PATIENCE_S)
    from_us = server._world.now_us
    eventually(lambda: server._world.now_us > from_us + 50_000, "blocks that wait in the queue")
    client.listen(False)
    busy.done.set()
    rest(server, client, ear)
    client.listen(True)
    stood_us = server._world.now_us
    eventually(lambda: ear.states[-1].t_us > stood_us + 50_000, "blocks after the rest")
    assert_without_gap(ear)


@pytest.mark.gate
def test_time_stands_still_for_nobody_and_goes_on_where_it_stopped(watched):
    server, client, ear = watched
    for _ in range(2):
        rest(server, client, ear)
        stood_us, beats = server._world.now_us, len(ear.states)
        sent, turns = server.beats, server.turns
        eventually(lambda: len(ear.states) >= beats + 5, "signs of life")  # noqa: B023
        assert {state.t_us for state in ear.states[beats:]} == {stood_us}
        longest = 1 + 2 * HEARTBEAT_S / (HEARTBEAT_S / 2)
        assert server.turns - turns <= longest * (server.beats - sent + 2), "it waits in each turn"
        eventually(lambda: client.status == "connected", "the next sign of life")
        client.listen(True)
        eventually(lambda: ear.states[-1].t_us > stood_us + 100_000, "ten blocks after the rest")  # noqa: B023
        assert client.lost_messages == 0
    assert_without_gap(ear)


def test_another_listener_keeps_time_passing_and_whoever_rests_hears_that_the_server_lives(watched):
    server, client, ear = watched
    with zmq.Context() as context, context.socket(zmq.SUB) as recorder:
        recorder.connect(client.address)
        recorder.subscribe(b"state")
        client.listen(False)
        eventually(
            lambda: server._topics == {b"state": 1, m.ALIVE: 1}, "the other listener only", lambda: server._topics
        )
        heard = len(ear.states)
        eventually(lambda: len(ear.states) > heard + 2, "signs of life")
        before_us = client.state.t_us
        eventually(lambda: client.state.t_us > before_us + 300_000, "time to pass")
        assert not client.state.ends_block and client.lost_messages == 0
        eventually(lambda: client.status == "connected", "the next sign of life")


def test_a_command_counts_as_somebody_for_a_while(watched):
    server, client, ear = watched
    rest(server, client, ear)
    before_us = client.state.t_us
    client.serve(5.0)
    eventually(lambda: client.state.t_us > before_us + 200_000, "20 blocks after the command")
    assert server._topics == {m.ALIVE: 1}


@pytest.mark.gate
def test_a_killed_server_is_noticed_and_its_successor_found():
    process, address = start(lasting_address())
    client = SimulationClient(address, timeout_s=1.0)  # after which the killed one is no longer waited for
    ear = Ear()

    def served() -> bool:
        try:
            return client.serve().ok
        except NoAnswerError:  # this machine is busy
            return False

    client.add_listener(ear)
    eventually(lambda: client.status == "connected" and ear.states, "the first block")
    process.kill()
    process.wait(PATIENCE_S)
    eventually(lambda: client.status == "lost", "the loss")
    with pytest.raises(LinkError, match="no answer"):
        client.serve()
    process, again = start(address)
    try:
        assert again == address
        eventually(lambda: client.status == "connected" and len(ear.welcomes) == 2, "the successor")
        assert ear.welcomes[0].session != ear.welcomes[1].session
        eventually(served, "a serve of the successor")
    finally:
        client.close()
        process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)


def test_recorded_balls_are_served_as_they_were_and_by_the_fitted_physics(tmp_path):
    state = dict.fromkeys(("pos_x", "vel_x", "w_vel_y", "w_vel_z"), 0.0)
    state |= {"pos_y": 1.2, "pos_z": 0.35, "vel_y": -5.0, "vel_z": 1.0, "w_vel_x": 40.0}
    file = tmp_path / "states.json"
    file.write_text(json.dumps([state]))
    process, where = start("tcp://127.0.0.1:0", "--ball-states", str(file))
    client = SimulationClient(where, timeout_s=PATIENCE_S)
    ear = Ear()
    client.add_listener(ear)
    eventually(lambda: ear.states, "the first block")  # a subscription takes a moment
    client.serve(5.0)
    eventually(lambda: ear.notices, "a notice of the serve")
    served = ear.notices[0]
    np.testing.assert_allclose((*served.p_m, *served.v_mps), (1.2, 0, 0.35, -5, 0, 1), atol=1e-9)
    np.testing.assert_allclose(served.spin_radps, (0, -40, 0), atol=1e-9)
    assert client.physics == physics_profile("real")
    client.close()
    process.kill()
    process.wait(PATIENCE_S)
