"""Both sides of a robot's link, on loopback: what leaves, what is taken, who stops it, and what happens to the lost."""

from __future__ import annotations

import dataclasses
import itertools
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import msgpack
import numpy as np
import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st

from core.errors import LinkError, NoAnswerError, TargetRefusedError
from core.live.link.guard import make_keys, read_client_keys, read_server_keys
from core.robot import RobotClient, RobotServer, RobotTarget, RobotWatchConfig, robot_server
from core.robot.motion_check import FaceMotion, find_fault
from core.robot.robot_client import host_us
from core.robot.robot_messages import (
    TO_ROBOT,
    HelloRobot,
    PingRobot,
    RobotState,
    RobotWelcome,
    StartRobot,
    decode_robot,
    encode_robot,
)
from core.robot.robot_watch import RobotWatch
from tests.core.robot.limits import LIMITS
from tests.core.robot.starting import start_until_answered
from tests.ports import lasting_address
from tests.waiting import PATIENCE_S, eventually

HOME, UPRIGHT, STILL = (-1.6, 0.0, 0.25), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
STROKE = (-1.42, 0.1, 0.3), UPRIGHT, (2.0, 0.0, 0.0)
PATIENT = RobotWatchConfig(lost_ms=10_000.0, slow_ms=5_000.0)
"""A busy machine is no part of most of these tests."""


class RestingRobot:
    """A robot on a thread that stands at home and notes the targets that it would carry out."""

    def __init__(self, address: str = "tcp://127.0.0.1:0", **options) -> None:
        self.ahead_us = 0
        self.server = RobotServer(
            address, LIMITS, name="resting", clock_us=lambda: time.monotonic_ns() // 1000 + self.ahead_us, **options
        )
        self.address, self.carried_out = self.server.address, []
        self.stop_for, self._ended, self.hold = "", threading.Event(), threading.Event()
        self.turns = 0
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._ended.is_set():
            time.sleep(0.002)
            self.turns += 1
            if self.hold.is_set():
                continue
            if self.stop_for:
                self.server.stop(self.stop_for)
            target = self.server.turn(HOME, UPRIGHT, STILL)
            if target is not None and target not in self.carried_out[-1:]:
                self.carried_out.append(target)

    def wait_until_it_has_looked(self) -> None:
        """Until it knows of a change of `hold` or `stop_for`."""
        seen = self.turns
        eventually(lambda: self.turns > seen + 1, "two turns of the robot")

    def close(self) -> None:
        self._ended.set()
        self._thread.join(PATIENCE_S)
        self.server.close()


@contextmanager
def playing(robot: RestingRobot, config: RobotWatchConfig = PATIENT, **options) -> Iterator[RobotClient]:
    client = RobotClient(robot.address, config=config, **options)
    try:
        eventually(lambda: client.status.connection == "ready", "the robot", lambda: client.status)
        start_until_answered(client)
        eventually(lambda: client.status.ready, "the start", lambda: client.status)
        yield client
    finally:
        client.close()


@pytest.fixture
def robot() -> Iterator[RestingRobot]:
    robot = RestingRobot()
    yield robot
    robot.close()


def aim_until_taken(client: RobotClient) -> None:
    """Answers take long on a busy machine, and then a target is stale."""

    def taken() -> bool:
        try:
            return client.aim(*STROKE, host_us() + 500_000).ok
        except (NoAnswerError, TargetRefusedError):
            return False

    eventually(taken, "a target to be taken", lambda: client.status)


def test_nothing_is_sent_before_a_person_has_started_it(robot: RestingRobot) -> None:
    client = RobotClient(robot.address, config=PATIENT)
    try:
        eventually(lambda: client.status.connection == "ready", "the robot")
        with pytest.raises(TargetRefusedError, match="not started yet"):
            client.aim(*STROKE, host_us() + 500_000)
        assert client.status.counts.sent == 0 and client.status.limits == LIMITS and client.status.name == "resting"
        start_until_answered(client)
        aim_until_taken(client)
        eventually(lambda: robot.carried_out, "a target to be carried out")
        (first, *_) = robot.carried_out
        assert first.p_m == STROKE[0] and first.v_mps == STROKE[2] and first.valid_until_us - first.sent_us == 100_000
        eventually(
            lambda: client.status.state is not None and client.status.state.stopped == "",
            "the state of a started robot",
        )
        assert client.status.state is not None and np.allclose(client.status.state.p_m, HOME)
    finally:
        client.close()
    eventually(lambda: "Rallyscope was ended" in robot.server.stopped, "the robot to hear of the end")


def test_a_target_names_the_cameras_behind_it_unless_the_names_are_too_long(robot: RestingRobot) -> None:
    with playing(robot) as client:
        for named, arrives in ((("left", "rgb"), ("left", "rgb")), ((), ()), (("n" * 3000,), ())):

            def taken(named=named) -> bool:
                with suppress(NoAnswerError, TargetRefusedError):
                    return client.aim(*STROKE, host_us() + 500_000, cameras=named).ok
                return False

            eventually(taken, "a target to be taken", lambda: client.status)
            eventually(
                lambda arrives=arrives: robot.carried_out and robot.carried_out[-1].cameras == arrives, "the names"
            )


def test_targets_of_older_and_of_later_versions_are_understood() -> None:
    target = RobotTarget(
        id=1, sent_us=0, valid_until_us=9, impact_us=9, p_m=HOME, q_wxyz=UPRIGHT, v_mps=STILL, cameras=("left",)
    )
    fields = msgpack.unpackb(encode_robot(target))
    assert fields["v"] == 1 and fields["cameras"] == ["left"]
    later = decode_robot(msgpack.packb(fields | {"not_known_yet": 1}), TO_ROBOT)
    assert later == target
    older = decode_robot(msgpack.packb({key: one for key, one in fields.items() if key != "cameras"}), TO_ROBOT)
    assert older == dataclasses.replace(target, cameras=())
    for wrong in ("left", [1], {"left": 1}, ["n" * 3000], None):
        with pytest.raises(LinkError, match="cameras"):
            decode_robot(msgpack.packb(fields | {"cameras": wrong}), TO_ROBOT)


def test_a_stop_from_here_is_told_to_the_robot_and_nothing_leaves_until_a_person_starts_it(robot: RestingRobot) -> None:
    with playing(robot) as client:
        client.stop("a person pressed Stop")
        eventually(lambda: robot.server.stopped == "rallyscope: a person pressed Stop", "the robot to hear of the stop")
        sent = client.status.counts.sent
        with pytest.raises(TargetRefusedError, match="a person pressed Stop") as refused:
            client.aim(*STROKE, host_us() + 500_000)
        assert refused.value.why == "stopped" and client.status.counts.sent == sent
        assert client.status.counts.not_ready == 1 and client.status.counts.stops == 1
        start_until_answered(client)
        eventually(lambda: not robot.server.stopped and client.status.ready, "the robot to be started again")
        aim_until_taken(client)


def test_a_stop_of_the_robot_is_told_here_with_its_reason(robot: RestingRobot) -> None:
    with playing(robot) as client:
        robot.stop_for = "the door is open"
        eventually(lambda: client.status.stop is not None, "the robot's stop")
        stop = client.status.stop
        assert stop is not None and (stop.by, stop.reason) == ("robot", "the door is open")
        with pytest.raises(TargetRefusedError, match="the door is open"):
            client.aim(*STROKE, host_us() + 500_000)
        start_until_answered(client)  # it is still open
        eventually(lambda: client.status.stop is not None and client.status.counts.stops >= 2, "the second stop")
        robot.stop_for = ""
        robot.wait_until_it_has_looked()
        start_until_answered(client)
        eventually(lambda: client.status.ready, "the start")


def test_a_target_that_was_held_up_on_the_way_is_not_carried_out(robot: RestingRobot) -> None:
    with playing(robot) as client:
        unanswered = client.status.counts.unanswered
        robot.hold.set()
        robot.wait_until_it_has_looked()
        with pytest.raises(NoAnswerError):
            client.aim(*STROKE, host_us() + 900_000)
        robot.hold.clear()
        assert client.status.counts.unanswered == unanswered + 1
        eventually(lambda: client.status.state is not None, "a state")
        seen_us = robot.server.now_us()
        eventually(lambda: client.status.state.t_us > seen_us and client.status.ready, "a state of after the hold")
        assert robot.carried_out == [] and client.status.state.following == 0


def test_a_robot_that_falls_silent_is_lost_and_sent_nothing_until_it_is_back(robot: RestingRobot) -> None:
    with playing(robot, RobotWatchConfig(lost_ms=400.0, slow_ms=1000.0)) as client:
        lost = client.status.counts.lost
        robot.hold.set()
        eventually(lambda: client.status.connection == "lost", "the loss")
        with pytest.raises(TargetRefusedError, match="nothing heard"):
            client.aim(*STROKE, host_us() + 500_000)
        assert client.status.counts.lost > lost and client.status.counts.sent == 0
        robot.hold.clear()
        eventually(lambda: client.status.ready, "the robot to be back")
        aim_until_taken(client)


def test_a_robot_that_stays_silent_is_counted_as_lost_once() -> None:
    watch = RobotWatch("tcp://127.0.0.1:1", RobotWatchConfig(lost_ms=400.0))
    watch.greet(RobotWelcome(id=1, session="s", name="silent", limits=LIMITS, t_us=0), 0.0)
    for sent_us in (1e4, 2e4, 3e4):
        watch.note_pong(sent_us, sent_us + 1000, round(sent_us) + 500)
    state = RobotState(
        session="s", t_us=40_000, p_m=HOME, q_wxyz=UPRIGHT, v_mps=STILL, following=0, stopped="", reason=""
    )
    watch.note_state(state, 4e4)
    assert [watch.look(now_us) for now_us in (5e4, 4.5e5, 1e6, 2e6)] == ["ready", "lost", "lost", "lost"]
    assert watch.counts.lost == 1


def test_a_robot_that_was_lost_when_it_was_stopped_hears_of_it_when_it_is_back(robot: RestingRobot) -> None:
    with playing(robot, RobotWatchConfig(lost_ms=400.0, slow_ms=1000.0)) as client:
        robot.hold.set()
        eventually(lambda: client.status.connection == "lost", "the loss")
        client.stop("nobody knows where it is")
        robot.hold.clear()
        eventually(
            lambda: robot.server.stopped == "rallyscope: nobody knows where it is", "the robot to hear of the stop"
        )
        eventually(
            lambda: client.status.connection == "ready" and client.status.state is not None, "the robot to be back"
        )
        assert client.status.stop is not None and not client.status.ready


def test_a_robot_that_answers_late_is_slow_and_sent_nothing(robot: RestingRobot) -> None:
    with playing(robot) as client:
        pass
    client = RobotClient(robot.address, config=RobotWatchConfig(slow_ms=1.0))
    try:  # its states are up to 5 ms old, and come every 5
        seen = []  # it may be quick again a moment later

        def is_slow() -> bool:
            seen.append(client.status)
            return seen[-1].connection == "slow"

        eventually(is_slow, "a slow robot", lambda: seen[-1])
        assert seen[-1].counts.slow >= 1 and "later than 1 ms" in seen[-1].problem
    finally:
        client.close()


def test_a_clock_that_jumps_is_counted_and_nothing_is_sent_until_it_is_known_again(robot: RestingRobot) -> None:
    with playing(robot) as client:
        before = client.status.clock
        robot.ahead_us = 5_000_000
        eventually(lambda: client.status.counts.clock_jumps == 1, "the first jump")
        eventually(lambda: client.status.ready and client.status.clock is not None, "the new clock")
        after = client.status.clock
        assert before is not None and after is not None
        assert abs(after.offset_us - before.offset_us - 5e6) < before.within_us + after.within_us + 2000
        robot.ahead_us = -5_000_000
        eventually(lambda: client.status.counts.clock_jumps >= 2 and client.status.ready, "the second jump")
        aim_until_taken(client)


def test_a_program_that_is_started_anew_waits_for_a_person() -> None:
    robot = RestingRobot(lasting_address())
    with playing(robot, RobotWatchConfig(lost_ms=400.0, slow_ms=1000.0)) as client:
        robot.close()
        eventually(lambda: client.status.connection == "lost", "the loss")
        again = RestingRobot(robot.address)
        try:
            eventually(lambda: client.status.connection == "ready", "the robot's successor")
            stop = client.status.stop
            assert stop is not None and "started anew" in stop.reason
            with pytest.raises(TargetRefusedError, match="started anew"):
                client.aim(*STROKE, host_us() + 500_000)
            start_until_answered(client)
            aim_until_taken(client)
            eventually(lambda: again.carried_out, "a target to be carried out")
        finally:
            client.stop("the test is over")
            again.close()


def test_only_one_rallyscope_commands(robot: RestingRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_server, "FREE_US", 10**12)  # however long a busy machine lets the first one be silent
    with playing(robot) as client:
        other = RobotClient(robot.address, config=PATIENT)
        try:
            eventually(lambda: "another Rallyscope" in other.status.problem, "the second client to be refused")
            assert other.status.connection == "awaited"
            eventually(lambda: client.status.ready, "the first client to play on", lambda: client.status)
            with pytest.raises(TargetRefusedError, match="not there"):
                other.start()
            client.close()
            monkeypatch.undo()
            eventually(lambda: other.status.connection == "ready", "the second client to be let in")
            assert robot.server.stopped, "whoever is new has to start it"
        finally:
            other.close()


def test_who_comes_after_one_that_vanished_finds_it_stopped_and_is_counted_from_one(robot: RestingRobot) -> None:
    context = zmq.Context()
    gone = context.socket(zmq.DEALER)
    gone.connect(robot.address)
    for message in (HelloRobot(id=1, client="gone"), StartRobot(id=10_000_000)):
        gone.send(encode_robot(message))
    eventually(lambda: robot.server.stopped == "", "the start")
    context.destroy(linger=0)
    client = RobotClient(robot.address, config=PATIENT)
    try:
        eventually(lambda: client.status.connection == "ready", "the robot")
        assert robot.server.stopped == "robot: not started yet: a person has to"
        start_until_answered(client)
        aim_until_taken(client)
    finally:
        client.close()


def test_garbage_is_counted_and_harms_nobody(robot: RestingRobot) -> None:
    context = zmq.Context()
    socket = context.socket(zmq.DEALER)
    socket.connect(robot.address)
    try:
        with playing(robot) as client:
            nan = RobotTarget(
                id=1, sent_us=0, valid_until_us=0, impact_us=0, p_m=(float("nan"),) * 3, q_wxyz=UPRIGHT, v_mps=STILL
            )
            bad = [b"", b"\x93", msgpack.packb({"v": 1}), b"x" * 5000, encode_robot(nan)]
            for data in (*bad, encode_robot(PingRobot(id=1, host_us=0))):
                socket.send(data)
            eventually(lambda: robot.server.rejected == 6, "six messages to be rejected")
            aim_until_taken(client)
            socket.send(b"x" * 100_000)  # cut off
            aim_until_taken(client)
            assert client.status.counts.rejected == 0
    finally:
        context.destroy(linger=0)


def test_beyond_this_machine_neither_side_begins_without_keys() -> None:
    for make in (lambda: RobotClient("tcp://10.1.2.3:5600"), lambda: RobotServer("tcp://0.0.0.0:0", LIMITS)):
        with pytest.raises(LinkError, match="needs keys"):
            make()
    with pytest.raises(LinkError, match="not an address"):
        RobotClient("ipc://robot")


def test_with_keys_the_right_one_plays_and_a_stranger_is_told_nothing(tmp_path) -> None:
    ours, theirs = make_keys(tmp_path / "ours"), make_keys(tmp_path / "theirs")
    robot = RestingRobot(keys=read_server_keys(ours[0]))
    try:
        with playing(robot, keys=read_client_keys(ours[1])) as client:
            aim_until_taken(client)
            strangers = [RobotClient(robot.address, keys=read_client_keys(theirs[1])), RobotClient(robot.address)]
            try:
                eventually(
                    lambda: strangers[0].status.problem == "its keys and ours do not fit", "the stranger to be refused"
                )
                assert all(one.status.connection == "awaited" for one in strangers)
                assert all(one.status.state is None and one.status.limits is None for one in strangers)
            finally:
                for one in strangers:
                    one.close()
    finally:
        robot.close()


class BareRobot:
    """A robot that speaks the messages itself, as the page tells them, and checks nothing: it only notes targets."""

    def __init__(self, version: int = 1) -> None:
        self._version = version
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self.address, self.targets, self._ended = f"tcp://127.0.0.1:{port}", [], threading.Event()
        self.p_m, self.v_mps, self.started = HOME, STILL, False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        who = None
        limits = {name: getattr(LIMITS, name) for name in LIMITS.__slots__}
        while not self._ended.is_set():
            if who is not None:
                self._send(who, "robot_state", session="bare", p_m=self.p_m, q_wxyz=UPRIGHT, v_mps=self.v_mps,
                    following=0, stopped="" if self.started else "robot", reason="")  # fmt: skip
            if not self._socket.poll(2):
                continue
            who, data = self._socket.recv_multipart()
            message = msgpack.unpackb(data)
            number, ok = message.get("id"), {"ok": True, "why": "", "said": ""}
            match message["kind"]:
                case "robot_hello":
                    self._send(who, "robot_welcome", id=number, session="bare", name="bare", limits=limits)
                case "robot_ping":
                    self._send(who, "robot_pong", id=number, host_us=message["host_us"])
                case "robot_target":
                    self.targets.append((time.monotonic_ns() // 1000, data))
                    self._send(who, "robot_answer", id=number, **ok)
                case "robot_start" | "robot_stop":
                    self.started = message["kind"] == "robot_start"
                    self._send(who, "robot_answer", id=number, **ok)

    def _send(self, who: bytes, kind: str, **fields: object) -> None:
        now_us = time.monotonic_ns() // 1000
        self._socket.send_multipart([who, msgpack.packb({"v": self._version, "kind": kind, "t_us": now_us, **fields})])

    def close(self) -> None:
        self._ended.set()
        self._thread.join(PATIENCE_S)
        self._context.destroy(linger=0)


@pytest.fixture(scope="module")
def bare() -> Iterator[tuple[BareRobot, RobotClient]]:
    robot = BareRobot()
    client = RobotClient(robot.address, config=PATIENT)
    eventually(lambda: client.status.connection == "ready", "the robot", lambda: client.status)
    start_until_answered(client)
    yield robot, client
    client.close()
    robot.close()


def test_a_robot_of_another_version_is_not_played_with_and_that_is_said() -> None:
    robot = BareRobot(version=2)
    client = RobotClient(robot.address)
    try:
        eventually(
            lambda: "another version of the link; expected version 1, got 2" in client.status.problem,
            "the version to be refused",
            lambda: client.status,
        )
        assert client.status.connection == "awaited" and client.status.counts.rejected > 0
    finally:
        client.close()
        robot.close()


ANY = st.floats() | st.floats(-3.0, 3.0)
SIXTY = st.floats() | st.floats(-1e5, 1e6)


@settings(max_examples=150)
@given(st.lists(ANY, min_size=10, max_size=10), SIXTY, st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6), ANY)
def _aim_and_look_at_the_wire(bare, wanted, lead_us, present, tame) -> None:
    robot, client = bare
    robot.p_m, robot.v_mps = tuple(np.array(HOME) + present[:3]), tuple(present[3:])
    if tame > 0:  # so that much leaves
        shift = np.nan_to_num(np.array(wanted), posinf=0, neginf=0).clip(-3, 3) / 6
        wanted = [*(np.array(STROKE[0]) + shift[:3] / 2), *UPRIGHT, *(np.array(STROKE[2]) + shift[3:6])]
        lead_us = 300_000.0 + 1e5 * float(shift[9])
    before = len(robot.targets)
    with suppress(TargetRefusedError, NoAnswerError):
        client.aim(wanted[:3], wanted[3:7], wanted[7:], host_us() + lead_us)
    for _, data in itertools.islice(robot.targets, before, None):
        sent = decode_robot(data, TO_ROBOT)
        assert isinstance(sent, RobotTarget) and len(data) < 500
        goal = FaceMotion.of(sent.p_m, sent.q_wxyz, sent.v_mps)
        assert goal.finite and np.linalg.norm(goal.v_mps) <= 5.0 and abs(np.linalg.norm(goal.q_wxyz) - 1) <= 1e-3
        assert all(low <= p <= high for low, p, high in zip(LIMITS.low_m, sent.p_m, LIMITS.high_m, strict=True))
        assert sent.sent_us < sent.valid_until_us <= sent.impact_us <= sent.sent_us + LIMITS.max_lead_us
        rest = FaceMotion.of(HOME, UPRIGHT, STILL)
        fault = find_fault(goal, sent.turn_radps, sent.impact_us - sent.sent_us, rest, LIMITS)
        assert fault is None or fault.why == "unreachable", "from where it is now it was reachable"


def test_nothing_outside_of_the_limits_is_ever_on_the_wire(bare) -> None:
    """Though much leaves, and much does not. Numbers of messages grow."""
    robot, client = bare
    _aim_and_look_at_the_wire(bare)
    counts = client.status.counts
    eventually(lambda: len(robot.targets) == counts.sent, "the last target", lambda: len(robot.targets))
    assert counts.sent > 10 and counts.kept_back > 10
    numbers = [decode_robot(data, TO_ROBOT).id for _, data in robot.targets]
    assert numbers == sorted(set(numbers))


@pytest.mark.parametrize("goal", [("a", "b", "c"), (1.0, 2.0), None, (1e400, 0, 0)])
def test_what_is_no_place_does_not_leave(bare, goal) -> None:
    _, client = bare
    with pytest.raises(TargetRefusedError):
        client.aim(goal, UPRIGHT, STILL, host_us() + 500_000)
