"""A real server process: served balls arrive, faults are survived."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgpack
import numpy as np
import pytest
import zmq

from core.errors import LinkError
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.physics.config import physics_profile
from core.physics.episode import Case


def start(bind: str = "tcp://127.0.0.1:0", *more: str) -> tuple[subprocess.Popen, str]:
    command = [sys.executable, "-c", "from app.cli import main; main()", "sim-server", "--bind", bind]
    process = subprocess.Popen(
        [*command, "--sensor", "320x240", "--seed", "3", *more], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    assert "tcp://" in line, line
    return process, line.split()[4]


def wait_for(true, seconds: float = 300) -> None:
    until = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def address():
    process, where = start()
    yield where
    process.send_signal(signal.SIGTERM)
    assert process.wait(300) == 0


@pytest.fixture
def client(address):
    client = SimulationClient(address)
    client.reset()
    client.set_speed(1.0)
    client.resume()
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


def test_a_served_ball_is_seen_by_both_cameras_and_judged(client):
    ear = Ear()
    client.add_listener(ear)
    client.set_speed(4.0)
    client.launch((1.0, 0.5, 0.3), (-5.0, 0.0, 1.0))
    wait_for(lambda: outcomes(ear))
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
        client.reset(5)
        client.add_listener(ear)
        client.serve(6.0)
        client.step(12)
        wait_for(lambda: ear.states and ear.states[-1].t_us == 120_000)
        client.remove_listener(ear)
        return [batch.x_px.tobytes() for batch in ear.batches if batch.session == ear.states[-1].session]

    first = session()
    assert len(first) == 24
    assert session() == first


def test_pause_single_step_and_slow_motion(client):
    client.pause()
    ear = Ear()
    client.add_listener(ear)
    t_us = client.ask(lambda number: m.Hello(id=number)).t_us
    time.sleep(0.3)
    assert client.ask(lambda number: m.Hello(id=number)).t_us == t_us
    wait_for(lambda: client.status == "connected")  # it beats while it pauses
    client.step(3)
    wait_for(lambda: ear.states and ear.states[-1].t_us == t_us + 30_000)
    client.set_speed(0.1)
    client.resume()
    began, t_us = time.monotonic(), client.ask(lambda number: m.Hello(id=number)).t_us
    time.sleep(0.5)
    ran_us = client.ask(lambda number: m.Hello(id=number)).t_us - t_us
    assert ran_us <= 1.2e5 * (time.monotonic() - began) + 20_000
    assert ran_us > 0


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
            assert socket.poll(5000)
            replies.append(m.decode(socket.recv(), m.KINDS))
        assert not any(reply.ok for reply in replies)
        assert "another version" in replies[-1].error and "too long" in replies[-2].error
        socket.send(b"\0" * (32 * m.COMMAND_BYTES))  # the sender is cut off
        time.sleep(0.1)
    assert client.ask(lambda number: m.Hello(id=number)).ok


def test_a_server_of_another_version_is_refused_with_both_versions():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as socket:
        port = socket.bind_to_random_port("tcp://127.0.0.1")

        def answer() -> None:
            who, _ = socket.recv_multipart()
            socket.send_multipart([who, msgpack.packb({"v": 7, "kind": "reply"})])

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(LinkError, match="expected version 1, got 7"):
            SimulationClient(f"tcp://127.0.0.1:{port - 1}")
        thread.join()


def test_no_server_is_one_clear_error():
    with pytest.raises(LinkError, match="rallyscope sim-server"):
        SimulationClient("tcp://127.0.0.1:9", timeout_s=0.2)


def simulated_per_second(client: SimulationClient, seconds: float = 0.25) -> float:
    began, t_us = time.monotonic(), client.ask(lambda number: m.Hello(id=number)).t_us
    time.sleep(seconds)
    return (client.ask(lambda number: m.Hello(id=number)).t_us - t_us) * 1e-6 / (time.monotonic() - began)


def test_the_scene_changes_between_two_blocks_and_stays_in_the_next_session(client):
    ear = Ear()
    client.pause()
    client.add_listener(ear)
    client.step(5)
    wait_for(lambda: ear.states and ear.states[-1].scene == "ball")
    client.set_scene("head")
    before = ear.states[-1].t_us
    client.step(10)
    wait_for(lambda: ear.states[-1].scene == "head" and ear.states[-1].t_us >= before + 100_000)
    starts_us = [batch.start_us for batch in ear.batches if batch.camera == "left"]
    assert set(np.diff(starts_us)) == {10_000}
    client.reset()
    client.step(1)
    wait_for(lambda: ear.states[-1].t_us == 10_000 and ear.states[-1].scene == "head")
    client.set_scene("ball")
    with pytest.raises(LinkError, match="no such choice"):
        client.set_scene("moon")


def test_a_subscriber_that_never_reads_does_not_slow_the_simulation(address, client):
    with zmq.Context() as context, context.socket(zmq.SUB) as slow:
        slow.setsockopt(zmq.RCVHWM, 1)
        slow.setsockopt(zmq.LINGER, 0)
        slow.connect(address)
        client.set_noise(20.0)
        client.set_speed(100.0)  # as fast as it can
        with_it, without = [], []
        for turn in range(44):  # in turns: other programs slow both, and many turns are asked for where they do much
            slow.subscribe(b"")
            with_it.append(simulated_per_second(client))
            slow.unsubscribe(b"")
            without.append(simulated_per_second(client))
            if turn % 11 == 10 and np.median(with_it) > 0.8 * np.median(without):
                break
        client.set_noise(0.1)
    assert np.median(with_it) > 0.8 * np.median(without)


@pytest.fixture(scope="module")
def fresh():
    """A process of its own, and the address of its server, which nobody has met yet before the first test of it."""
    process, address = start("tcp://127.0.0.1:0", "--auto-serve", "5")
    yield process, address
    process.kill()
    process.wait()


def test_time_begins_with_the_first_client():
    process, address = start("tcp://127.0.0.1:0", "--auto-serve", "5")
    try:
        time.sleep(1.0)
        came_s = time.monotonic()
        client = SimulationClient(address)
        t_us = client.ask(lambda number: m.Hello(id=number)).t_us
        assert t_us * 1e-6 <= time.monotonic() - came_s + 0.02
        client.close()
    finally:
        process.kill()
        process.wait()


def test_time_begins_for_one_who_only_listens(fresh):
    _, address = fresh
    with zmq.Context() as context, context.socket(zmq.SUB) as listener:
        listener.setsockopt(zmq.RCVTIMEO, 10_000)
        listener.connect(address)
        listener.subscribe(b"state")
        assert [m.decode(listener.recv_multipart()[1], m.KINDS).t_us for _ in range(3)][-1] >= 30_000


def processor_s(process: subprocess.Popen) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def test_time_stands_still_for_nobody_and_goes_on_where_it_stopped(client_of_its_own):
    process, client = client_of_its_own
    ear = Ear()
    client.add_listener(ear)
    wait_for(lambda: len(ear.states) > 10)
    client.listen(False)
    wait_until_it_stands(client)
    stood_us, spent_s = client.state.t_us, processor_s(process)
    time.sleep(1.0)
    assert client.state.t_us == stood_us
    assert processor_s(process) - spent_s < 0.1 * 1.0
    wait_for(lambda: client.status == "connected")
    heard = len(ear.batches)
    back_after_s = [seconds_until_it_goes_on(client, ear)]
    wait_for(lambda: ear.states[-1].t_us > stood_us + 100_000)
    starts_us = [batch.start_us for batch in ear.batches[heard:]]
    assert starts_us[0] <= stood_us + 10_000  # a block may have been under way
    assert client.lost_messages == 0
    for _ in range(2):  # a machine may be busy once
        client.listen(False)
        wait_until_it_stands(client)
        back_after_s.append(seconds_until_it_goes_on(client, ear))
    assert min(back_after_s) < 1.0


def wait_until_it_stands(client: SimulationClient) -> None:
    seen_us: list[int] = []

    def stands() -> bool:
        seen_us.append(client.state.t_us)
        time.sleep(0.1)
        return len(seen_us) > 10 and len(set(seen_us[-10:])) == 1

    wait_for(stands)


def seconds_until_it_goes_on(client: SimulationClient, ear: Ear) -> float:
    heard, came_s = len(ear.batches), time.monotonic()
    client.listen(True)
    wait_for(lambda: len(ear.batches) > heard + 1)
    return time.monotonic() - came_s


def test_another_listener_keeps_time_passing_and_whoever_rests_hears_that_the_server_lives(client_of_its_own):
    _, client = client_of_its_own
    with zmq.Context() as context, context.socket(zmq.SUB) as recorder:
        recorder.connect(client.address)
        recorder.subscribe(b"state")
        client.listen(False)
        time.sleep(0.5)
        before_us = client.state.t_us
        time.sleep(1.5)
        wait_for(lambda: client.status == "connected")
        assert client.state.t_us > before_us


def test_a_command_counts_as_somebody_for_a_while(client_of_its_own):
    _, client = client_of_its_own
    client.listen(False)
    time.sleep(0.5)
    client.serve(5.0)
    before_us = client.state.t_us
    wait_for(lambda: client.state.t_us > before_us + 200_000)


@pytest.fixture
def client_of_its_own(fresh):
    """The only client of a server, and the process of it."""
    process, address = fresh
    client = SimulationClient(address)
    wait_for(lambda: client.state is not None)
    yield process, client
    client.close()


def test_a_killed_server_is_noticed_and_its_successor_found():
    process, address = start()
    client = SimulationClient(address, timeout_s=1.0)
    ear = Ear()
    client.add_listener(ear)
    wait_for(lambda: client.status == "connected" and ear.states)
    process.kill()
    process.wait()
    wait_for(lambda: client.status == "lost")
    with pytest.raises(LinkError, match="no answer"):
        client.serve()
    process, again = start(address)
    try:
        assert again == address
        wait_for(lambda: client.status == "connected" and len(ear.welcomes) == 2)
        assert ear.welcomes[0].session != ear.welcomes[1].session
        assert client.serve().ok
    finally:
        client.close()
        process.send_signal(signal.SIGTERM)
        process.wait(300)


def test_recorded_balls_are_served_as_they_were_and_by_the_fitted_physics(tmp_path):
    state = dict.fromkeys(("pos_x", "vel_x", "w_vel_y", "w_vel_z"), 0.0)
    state |= {"pos_y": 1.2, "pos_z": 0.35, "vel_y": -5.0, "vel_z": 1.0, "w_vel_x": 40.0}
    file = tmp_path / "states.json"
    file.write_text(json.dumps([state]))
    process, where = start("tcp://127.0.0.1:0", "--ball-states", str(file))
    client = SimulationClient(where)
    ear = Ear()
    client.add_listener(ear)
    wait_for(lambda: ear.states)  # a subscription takes a moment
    client.serve(5.0)
    wait_for(lambda: ear.notices)
    served = ear.notices[0]
    np.testing.assert_allclose((*served.p_m, *served.v_mps), (1.2, 0, 0.35, -5, 0, 1), atol=1e-9)
    np.testing.assert_allclose(served.spin_radps, (0, -40, 0), atol=1e-9)
    assert client.physics == physics_profile("real")
    client.close()
    process.kill()
    process.wait()
