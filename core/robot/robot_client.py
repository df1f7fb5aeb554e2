"""Rallyscope's side of a robot's link. Every target that leaves passes `aim`, and there the check of the limits."""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections.abc import Sequence
from typing import Final

import zmq

from core.errors import LinkError, NoAnswerError, TargetRefusedError
from core.live.link.fields import text_bytes
from core.live.link.guard import ClientKeys, HandshakeWatch, check_reach, secure, split_address
from core.robot.motion_check import NOT_STARTED, FaceMotion, find_fault
from core.robot.robot_messages import (
    CAMERAS_BYTES,
    FROM_ROBOT,
    ROBOT_MESSAGE_BYTES,
    HelloRobot,
    PingRobot,
    RobotAnswer,
    RobotPong,
    RobotState,
    RobotTarget,
    RobotWelcome,
    StartRobot,
    StopRobot,
    decode_robot,
    encode_robot,
)
from core.robot.robot_watch import RobotStatus, RobotWatch, RobotWatchConfig, StopNote

logger = logging.getLogger(__name__)

PING_EVERY_US: Final = 50_000
HELLO_EVERY_US: Final = 200_000
WAIT_MS: Final = 10
VALID_US: Final = 100_000
"""Validity of a target, us: an older one must not be started."""
ANSWER_S: Final = 0.3


class RobotClient:
    """Connection to a robot that may appear and disappear. Thread-safe, with a thread of its own.

    Nothing is sent to it before a person has started it (`start`), and nothing after a stop, from either side, until
    somebody does so again.
    """

    def __init__(self, address: str, *, keys: ClientKeys | None = None, config: RobotWatchConfig | None = None) -> None:
        """Look for a robot from now on; there need not be one yet.

        Raises:
            LinkError: if it is no address, or beyond this machine without keys.
        """
        host, _ = split_address(address, lowest=1)
        check_reach(host, keys)
        self.address, self._keys, self._client = address, keys, uuid.uuid4().hex
        self._lock = threading.RLock()
        self._watch = RobotWatch(address, config or RobotWatchConfig(), stop=StopNote("rallyscope", NOT_STARTED))
        self._number = 0
        self._starting: int | None = None
        """Pending start request."""
        self._answers: dict[int, RobotAnswer | None] = {}
        self._answered = threading.Condition(self._lock)
        self._pinged_us = self._greeted_us = -1e18
        self._pings: dict[int, float] = {}
        self._context = zmq.Context()
        # A ZMQ socket belongs to one thread: orders of the others come to it through this pair.
        self._orders, self._ordered = self._context.socket(zmq.PAIR), self._context.socket(zmq.PAIR)
        self._ordered.bind("inproc://orders")
        self._orders.connect("inproc://orders")
        try:
            self._connect()
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise LinkError(f"cannot connect ({error})", got=address) from error
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="robot-link", daemon=True)
        self._thread.start()

    @property
    def status(self) -> RobotStatus:
        """Status of the robot."""
        with self._lock:
            return self._watch.status(host_us())

    def states_since(self, robot_us: int) -> list[RobotState]:
        """The robot's states of the last seconds that are later than a time of its clock, in order."""
        with self._lock:
            return [state for state in self._watch.states if state.t_us > robot_us]

    def aim(
        self,
        p_m: object,
        q_wxyz: object,
        v_mps: object,
        impact_us: float,
        *,
        turn_radps: tuple[float, ...] | None = None,
        cameras: Sequence[str] = (),
    ) -> RobotAnswer:
        """Send the middle of the face to a pose with a velocity at a time of this machine's clock (`host_us`).

        The only way by which a target leaves. It does not if the robot is not ready, or if anything about it is
        outside of the robot's limits.

        Args:
            p_m: (3,) middle of the face, world.
            q_wxyz: (4,) orientation, world.
            v_mps: (3,) velocity, world.
            impact_us: when, on this machine's clock.
            turn_radps: (3,) turn rate, rad/s, world.
            cameras: names of the cameras that the answer behind it is made of, for the robot's information.

        Raises:
            TargetRefusedError: if it did not leave, or the robot did not take it.
            NoAnswerError: if the robot did not say.
        """
        with self._lock:
            target = self._checked_target(p_m, q_wxyz, v_mps, impact_us, turn_radps, cameras)
            self._answers[target.id] = None
            self._orders.send(encode_robot(target))
            self._watch.count(sent=1)
        answer = self._wait_for_answer(target.id, "target")
        with self._lock:
            self._watch.count(taken=answer.ok, refused=not answer.ok)
            if not answer.ok:
                self._watch.last_refusal = f"by the robot: {answer.said}"
                raise TargetRefusedError(answer.why, answer.said, where="the robot")
        return answer

    def reject_locally(self, why: str, detail: str) -> TargetRefusedError:
        """Count a target that is not sent; returns the error."""
        with self._lock:
            is_fault = why in ("bounds", "unreachable", "late", "early")
            self._watch.count(kept_back=is_fault, not_ready=not is_fault)
            if is_fault or why == "clock":
                self._watch.last_refusal = f"kept back: {detail}"
        return TargetRefusedError(why, detail, where="not sent to the robot")

    def stop(self, reason: str) -> None:
        """Stop the robot: nothing is sent any more, and the stop is repeated until it is confirmed."""
        with self._lock:
            self._starting = None
            self._watch.halt(StopNote("rallyscope", reason[:200]))
            if self._watch.welcome is not None:
                self._orders.send(encode_robot(StopRobot(id=self._next(), reason=reason[:200])))

    def start(self) -> None:
        """Start the robot on a person's request; targets are sent only after that.

        Raises:
            TargetRefusedError: if the robot is not there, or does not want to.
            NoAnswerError: if it does not say.
        """
        with self._lock:
            if self._watch.welcome is None or self._ended.is_set():
                raise TargetRefusedError("lost", "it cannot be started: it is not there", where="the robot")
            number = self._starting = self._next()
            self._answers[number] = None
            self._orders.send(encode_robot(StartRobot(id=number)))
        try:
            answer = self._wait_for_answer(number, "start")
        finally:
            with self._lock:
                self._starting = None if self._starting == number else self._starting
        if not answer.ok:
            raise TargetRefusedError(answer.why, answer.said, where="the robot")

    def close(self) -> None:
        """Stop the robot and disconnect; may be called again."""
        if self._ended.is_set():
            return
        self.stop("Rallyscope was ended")
        self._ended.set()
        self._thread.join()
        self._context.destroy(linger=200)

    # The only place that sends targets.

    def _checked_target(
        self,
        p_m: object,
        q_wxyz: object,
        v_mps: object,
        impact_us: float,
        turn_radps: tuple[float, ...] | None,
        cameras: Sequence[str],
    ) -> RobotTarget:
        """Within all limits, or an error; the lock is held."""
        now_us, watch = host_us(), self._watch
        if watch.stop is not None:
            raise self.reject_locally("stopped", f"stopped by {watch.stop.by}: {watch.stop.reason}")
        if watch.look(now_us) != "ready":
            raise self.reject_locally("lost", watch.status(now_us).problem)
        welcome, clock, state = watch.welcome, watch.clock.estimate, watch.state
        assert welcome is not None and clock is not None and state is not None
        try:
            goal = FaceMotion.of(p_m, q_wxyz, v_mps)
            sent_us, hit_us = clock.robot_us(now_us), clock.robot_us(impact_us)
        except (ValueError, TypeError, OverflowError) as error:
            raise self.reject_locally("bounds", f"not a target: {error}") from error
        # Where the racket is now, not when its last state was sent.
        age_s = max(0, sent_us - state.t_us) * 1e-6
        now = FaceMotion.of(state.p_m, state.q_wxyz, state.v_mps).after(age_s)
        fault = find_fault(goal, turn_radps, hit_us - sent_us, now, welcome.limits)
        if fault is not None:
            raise self.reject_locally(*fault)
        return RobotTarget(
            id=self._next(), sent_us=sent_us, valid_until_us=min(hit_us, sent_us + VALID_US), impact_us=hit_us,
            p_m=tuple(goal.p_m.tolist()), q_wxyz=tuple(goal.q_wxyz.tolist()), v_mps=tuple(goal.v_mps.tolist()),
            turn_radps=turn_radps,
            # Names that are too long to say are no reason to hold a stroke back.
            cameras=tuple(cameras) if text_bytes(cameras) <= CAMERAS_BYTES else (),
        )  # fmt: skip

    def _wait_for_answer(self, number: int, what: str) -> RobotAnswer:
        with self._answered:
            self._answered.wait_for(lambda: self._answers[number] is not None, ANSWER_S)
            answer = self._answers.pop(number)
            if answer is None:
                self._watch.count(unanswered=1)
                raise NoAnswerError(f"the robot did not answer to a {what} in {ANSWER_S:g} s", where=self.address)
            return answer

    def _next(self) -> int:
        self._number += 1
        return self._number

    # Its own thread, which alone uses the socket.

    def _connect(self) -> None:
        self._socket = self._context.socket(zmq.DEALER)
        for option, value in ((zmq.LINGER, 0), (zmq.IMMEDIATE, 1), (zmq.RECONNECT_IVL_MAX, 500), (zmq.SNDHWM, 100)):
            self._socket.setsockopt(option, value)
        self._socket.setsockopt(zmq.MAXMSGSIZE, 4 * ROBOT_MESSAGE_BYTES)
        secure(self._socket, self._keys)
        self._handshakes = HandshakeWatch(self._socket, self._keys)
        self._socket.connect(self.address)

    def _run(self) -> None:
        poller = zmq.Poller()
        poller.register(self._socket, zmq.POLLIN)
        poller.register(self._ordered, zmq.POLLIN)
        try:
            while not self._ended.is_set():
                ready = dict(poller.poll(WAIT_MS))
                self._forward()
                if self._socket in ready:
                    self._receive()
                self._keep_up()
            self._forward()
        except Exception:
            logger.exception("the robot's link failed")
        finally:
            self._handshakes.close()
            self._socket.close(200)

    def _forward(self) -> None:
        while self._ordered.poll(0):
            self._send(self._ordered.recv())

    def _send(self, data: bytes) -> None:
        try:
            self._socket.send(data, zmq.NOBLOCK)
        except zmq.ZMQError as error:  # no connection: unsent targets must not be sent later
            logger.debug("not sent: %s", error)

    def _receive(self) -> None:
        for _ in range(200):
            if not self._socket.poll(0):
                return
            data = self._socket.recv_multipart()[-1]
            with self._lock:
                try:
                    self._hear(decode_robot(data, FROM_ROBOT))
                except LinkError as error:
                    self._watch.count(rejected=1)
                    self._watch.barred = f"it is not understood: {error}"
                    logger.debug("ignored: %s", error)

    def _hear(self, message: object) -> None:
        now_us, watch = host_us(), self._watch
        match message:
            case RobotWelcome():
                watch.greet(message, now_us)
            case RobotPong():
                sent_us = self._pings.pop(message.id, None)
                if sent_us is not None and watch.welcome is not None:
                    watch.note_pong(sent_us, now_us, message.t_us)
            case RobotState():
                watch.note_state(message, now_us)
            case RobotAnswer():
                self._hear_answer(message)

    def _hear_answer(self, answer: RobotAnswer) -> None:
        if answer.why in ("stranger", "not a message"):
            self._watch.barred = f"it says: {answer.said}"
        if answer.why == "stranger":
            self._watch.welcome = None
        if answer.id == self._starting:
            self._starting = None
            self._watch.stop = None if answer.ok else self._watch.stop
        if answer.id in self._answers:
            self._answers[answer.id] = answer
            self._answered.notify_all()

    def _keep_up(self) -> None:
        """Do what is due: handshake, clock comparison, repeated stop."""
        now_us, watch = host_us(), self._watch
        with self._lock:
            watch.look(now_us)
            if watch.welcome is None:
                if now_us - self._greeted_us > HELLO_EVERY_US:
                    self._greeted_us = now_us
                    if self._handshakes.refused():
                        watch.barred = "its keys and ours do not fit"
                    self._send(encode_robot(HelloRobot(id=self._next(), client=self._client)))
                return
            if now_us - self._pinged_us < PING_EVERY_US:
                return
            self._pinged_us, clock = now_us, watch.clock.estimate
            number = self._next()
            # A robot that does not answer must not fill the memory.
            if len(self._pings) > 100:
                self._pings.clear()
            self._pings[number] = now_us
            offset_us, within_us = (None, None) if clock is None else (clock.offset_us, clock.within_us)
            ping = PingRobot(id=number, host_us=round(now_us), offset_us=offset_us, within_us=within_us)
            self._send(encode_robot(ping))
            if watch.stop is None or self._starting is not None:
                return
            if watch.state is not None and not watch.state.stopped:
                self._send(encode_robot(StopRobot(id=self._next(), reason=watch.stop.reason)))


def host_us() -> float:
    """This machine's clock that never runs backwards, microseconds."""
    return time.monotonic() * 1e6
