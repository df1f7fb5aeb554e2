"""The robot's side of the link: answers Rallyscope, reports the racket's pose, and passes on valid targets.

For the program of a robot in Python, which calls `turn` in its own loop; others speak the messages themselves.
"""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Callable
from typing import Final, Self

import zmq
from numpy.typing import ArrayLike

from core.errors import LinkError
from core.live.link.fields import read_fields, write_fields
from core.live.link.guard import LinkGateway, ServerKeys, check_reach, split_address
from core.robot.motion_check import FaceMotion, MotionFault, TargetArbiter
from core.robot.robot_messages import (
    ROBOT_MESSAGE_BYTES,
    TO_ROBOT,
    HelloRobot,
    PingRobot,
    RobotAnswer,
    RobotLimits,
    RobotPong,
    RobotState,
    RobotTarget,
    RobotWelcome,
    StartRobot,
    StopRobot,
    decode_robot,
    encode_robot,
)

logger = logging.getLogger(__name__)

STATE_EVERY_US: Final = 5_000
FREE_US: Final = 1_000_000
"""Silence after which another client may take command."""
MAX_AT_ONCE: Final = 50
"""Most messages per turn."""


class RobotServer:
    """Listens on a port for one Rallyscope; used by one thread. It begins stopped, until a person starts it there."""

    def __init__(
        self,
        address: str,
        limits: RobotLimits,
        *,
        name: str = "robot",
        keys: ServerKeys | None = None,
        clock_us: Callable[[], int] = lambda: time.monotonic_ns() // 1000,
    ) -> None:
        """Port 0 takes a free one. With `keys` only their clients are heard; beyond this machine there must be some.

        Raises:
            LinkError: if a limit is out of bounds, the port cannot be had, or others could reach it without keys.
        """
        host, port = split_address(address)
        check_reach(host, keys)
        # Through the message's own checks: limits that a client would refuse are refused here.
        self.limits: RobotLimits = read_fields(RobotLimits, write_fields(limits), "limits")
        self.now_us = clock_us
        """Clock of all times, us."""
        self.rejected = 0
        """Invalid messages, and messages of other clients."""
        self.offset_us: float | None = None
        """Rallyscope's estimate of this clock's offset to its own, us."""
        self._name, self._session = name[:64], uuid.uuid4().hex
        self._keeper = TargetArbiter(self.limits)
        self._commander: bytes | None = None
        self._client = ""
        self._received_us = self._reported_us = 0
        self._context = zmq.Context()
        self._gateway = LinkGateway(self._context, keys)
        self._socket = self._context.socket(zmq.ROUTER)
        for option, value in ((zmq.LINGER, 0), (zmq.MAXMSGSIZE, 4 * ROBOT_MESSAGE_BYTES), (zmq.RCVHWM, 200)):
            self._socket.setsockopt(option, value)
        self._socket.setsockopt(zmq.SNDHWM, 200)
        self._gateway.guard(self._socket)
        try:
            self._socket.bind(f"tcp://{host}:{port or '*'}")
        except zmq.ZMQError as error:
            self.close()
            raise LinkError(f"cannot listen ({error})", got=address, remedy="end what uses the port") from error
        bound = int(bytes(self._socket.getsockopt_string(zmq.LAST_ENDPOINT), "ascii").rpartition(b":")[2])
        self.address = f"tcp://{host}:{bound}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    @property
    def stopped(self) -> str:
        """Who stopped it and why; empty while it plays."""
        return f"{self._keeper.stopped}: {self._keeper.reason}" if self._keeper.stopped else ""

    def stop(self, reason: str) -> None:
        """The robot stops by itself: nothing is carried out until a person starts it again in Rallyscope."""
        self._keeper.stop("robot", reason[:200])
        self._reported_us = 0

    def turn(self, p_m: ArrayLike, q_wxyz: ArrayLike, v_mps: ArrayLike) -> RobotTarget | None:
        """Hear and answer what has come, and tell where the racket is; never waits. Call it 100 times a second or more.

        Takes the middle of the face (3,), its orientation (4,) and its velocity (3,), in the world, as they are now.
        Gives the target to carry out now; None: hold still, or go to rest if it is not stopped.

        Raises:
            ValueError: for other shapes.
        """
        motion = FaceMotion.of(p_m, q_wxyz, v_mps)
        for _ in range(MAX_AT_ONCE):
            if not self._socket.poll(0):
                break
            who, *_, data = self._socket.recv_multipart()
            self._hear(who, data, motion)
        now_us = self.now_us()
        target = self._keeper.target(now_us)
        if abs(now_us - self._reported_us) >= STATE_EVERY_US:
            self._reported_us = now_us
            self._tell(motion, target, now_us)
        return target

    def close(self) -> None:
        """Close the port; may be called again."""
        self._gateway.close()
        if not self._context.closed:
            self._context.destroy(linger=0)

    def _tell(self, motion: FaceMotion, target: RobotTarget | None, now_us: int) -> None:
        if self._commander is None or not motion.finite:
            return
        p, q, v = (tuple(a.tolist()) for a in (motion.p_m, motion.q_wxyz, motion.v_mps))
        keeper = self._keeper
        state = RobotState(
            session=self._session, t_us=now_us, p_m=p, q_wxyz=q, v_mps=v,
            following=0 if target is None else target.id, stopped=keeper.stopped, reason=keeper.reason,
        )  # fmt: skip
        self._send(self._commander, state)

    def _hear(self, who: bytes, data: bytes, motion: FaceMotion) -> None:
        try:
            message = decode_robot(data, TO_ROBOT)
        except LinkError as error:
            self.rejected += 1
            self._answer(who, 0, "not a message", str(error))
            return
        if isinstance(message, HelloRobot):
            self._welcome(who, message)
        elif who != self._commander:
            self.rejected += 1
            self._answer(who, message.id, "stranger", "another Rallyscope commands it, or there was no hello")
        else:
            self._received_us = self.now_us()
            self._keeper.hear(self._received_us)
            self._obey(who, message, motion)

    def _welcome(self, who: bytes, hello: HelloRobot) -> None:
        now_us = self.now_us()
        is_known = hello.client == self._client
        if self._commander is not None and not is_known and now_us - self._received_us < FREE_US:
            self._answer(who, hello.id, "stranger", "another Rallyscope commands it")
            return
        if not is_known:
            self._keeper.begin_anew()
        self._commander, self._client, self._received_us = who, hello.client, now_us
        self._keeper.hear(now_us)
        welcome = RobotWelcome(id=hello.id, session=self._session, name=self._name, limits=self.limits, t_us=now_us)
        self._send(who, welcome)

    def _obey(self, who: bytes, message: object, motion: FaceMotion) -> None:
        match message:
            case PingRobot():
                self.offset_us = message.offset_us
                self._send(who, RobotPong(id=message.id, host_us=message.host_us, t_us=self.now_us()))
            case RobotTarget():
                fault = self._keeper.offer(message, motion, self.now_us()) or MotionFault("", "")
                self._answer(who, message.id, fault.why, fault.detail)
            case StopRobot():
                self._keeper.stop("rallyscope", message.reason, message.id)
                self._answer(who, message.id)
            case StartRobot():
                started = self._keeper.start(message.id)
                self._answer(who, message.id, *(() if started else ("older", "a newer request was here before")))

    def _answer(self, who: bytes, number: int, why: str = "", detail: str = "") -> None:
        self._send(who, RobotAnswer(id=number, ok=not why, why=why, said=detail[:300], t_us=self.now_us()))

    def _send(self, who: bytes, message: object) -> None:
        try:
            self._socket.send_multipart([who, encode_robot(message)], zmq.NOBLOCK)
        except zmq.ZMQError as error:  # nobody reads: nothing waits for that
            logger.debug("not sent: %s", error)
