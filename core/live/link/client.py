"""Client of the simulation link: commands with time-outs, and published messages for listeners."""

from __future__ import annotations

import contextlib
import itertools
import logging
import socket
import threading
import time
from collections.abc import Callable, Sequence
from typing import Final, Self

import zmq

from core.chain.control.hit_choice import RacketReach
from core.errors import LinkError, NoAnswerError, NotReadyError, RefusedError
from core.live.link import messages as m
from core.live.link.guard import ClientKeys, HandshakeWatch, check_reach, secure, split_address
from core.live.link.live_source import LinkListener, LinkListeners, SourceStatus
from core.physics.config import PhysicsConfig
from core.simulation.episodes.racket import RacketConfig

logger = logging.getLogger(__name__)

LOST_S: Final = 1.0
"""Time without a heartbeat after which the server counts as lost; it sends ten per second."""
SILENT_S: Final = 60.0
"""Longest silence of a listening server during the handshake: it may be starting on a slow machine."""
SUBSCRIBE: Final = b"\x01"
UNSUBSCRIBE: Final = b"\x00"
"""First byte of what a subscriber sends, before the topic."""
HELLO_S: Final = 3.0
"""Longest wait for an answer to one handshake: where no server is, that is to be known soon, however patient one is."""
ASK_AGAIN_S: Final = 0.2
SCENE_S: Final = 30.0
"""Timeout of the reply to a new scene, which is rendered first: half a second on an idle machine."""


class SimulationClient:
    """A connection to a simulation server. It survives the server's end and finds its successor by itself.

    It is a LiveSource with everything: cameras, a robot, outcomes and truth.
    """

    description = "live simulation"
    has_outcomes = True
    behind_s = 0.0

    def __init__(
        self,
        address: str,
        *,
        timeout_s: float = 3.0,
        preparing: Callable[[float], None] = lambda share: None,
        keys: ClientKeys | None = None,
    ) -> None:
        """Connect and shake hands; with a server that is being prepared as soon as it is ready.

        `preparing` hears again and again how far such a server is, 0 to 1. With `keys` it is the server that they name,
        and nobody on the way can listen; beyond this machine there must be some.

        Raises:
            LinkError: if there is no server, or one of another version, or keys do not fit or are missing.
        """
        host, port = split_address(address, lowest=1)
        check_reach(host, keys)
        self.address, self._keys = address, keys
        self._commands_address = f"tcp://{host}:{port + 1}"
        self._timeout_s = timeout_s
        self._context = zmq.Context()
        self._numbers = itertools.count(1)
        # A request socket has one question at a time; the second lock is for what the receiving thread changes.
        self._asking, self._lock = threading.Lock(), threading.Lock()
        self._socket: zmq.Socket | None = None
        self._watch: HandshakeWatch | None = None
        self._listeners = LinkListeners()
        self._stop, self._has_received = threading.Event(), threading.Event()
        self._received_s = 0.0
        self._last_seq = 0
        self._listening = True
        self.lost_messages = self.rejected_messages = 0
        """Published messages that never came; messages that came and were no messages."""
        self.state: m.WorldState | None = None
        """Latest state."""
        try:
            self.welcome = self._shake_hands(preparing)
        except BaseException:
            self._drop_socket()
            self._context.destroy(linger=0)
            raise
        self._thread = threading.Thread(target=self._receive, name="simulation-link", daemon=True)
        self._thread.start()

    @property
    def robot(self) -> Self | None:
        """The racket over there; None where the server says that it has none."""
        return self if self.welcome.robot else None

    @property
    def reach(self) -> RacketReach:
        """Limits of the simulated racket."""
        return RacketReach.of_config(RacketConfig())

    @property
    def status(self) -> SourceStatus:
        """Connection status."""
        return "connected" if time.monotonic() - self._received_s < LOST_S else "lost"

    @property
    def physics(self) -> PhysicsConfig:
        """Physics of the server; the paper's if it does not state one."""
        return self.welcome.physics or PhysicsConfig()

    def add_listener(self, listener: LinkListener) -> None:
        """Add a listener; it gets the present session at once."""
        with self._lock:
            self._listeners.add(listener, self.welcome)

    def remove_listener(self, listener: LinkListener) -> None:
        """Remove a listener."""
        with self._lock:
            self._listeners.remove(listener)

    def listen(self, listening: bool) -> None:
        """Hear everything, or, where nobody needs it, only that the server lives: it rests if nobody else listens.

        A tenth of a second may pass until it is so.
        """
        self._listening = listening

    def wait_for_messages(self) -> None:
        """Wait for the first published message: from then on everything comes, before it some may have been missed.

        Raises:
            NoAnswerError: if none comes in the client's time-out.
        """
        if not self._has_received.wait(self._timeout_s):
            raise NoAnswerError("the server publishes nothing", where=self.address, remedy="start it again")

    def serve(self, speed_mps: float = 5.0) -> m.Reply:
        """Serve a ball drawn for a speed of 3 to 9 m/s."""
        return self.ask(lambda number: m.Serve(id=number, speed_mps=speed_mps))

    def launch(
        self, p_m: tuple[float, ...], v_mps: tuple[float, ...], spin_radps: tuple[float, ...] = (0.0, 0.0, 0.0)
    ) -> m.Reply:
        """Serve a ball with exactly this state."""
        return self.ask(lambda number: m.Serve(id=number, p_m=p_m, v_mps=v_mps, spin_radps=spin_radps))

    def aim_racket(
        self,
        p_m: tuple[float, ...],
        q_wxyz: tuple[float, ...],
        v_mps: tuple[float, ...],
        t_us: int,
        cameras: Sequence[str] = (),
    ) -> m.Reply:
        """Send the middle of the racket's face to a pose with a velocity at a simulated time.

        Args:
            p_m: (3,) middle of the face, world.
            q_wxyz: (4,) its orientation in the world.
            v_mps: (3,) its velocity, world.
            t_us: simulated time at which it is to be so.
            cameras: not sent: the simulation knows what its cameras see.
        """
        return self.ask(lambda number: m.AimRacket(id=number, p_m=p_m, q_wxyz=q_wxyz, v_mps=v_mps, t_us=t_us))

    def rest_racket(self) -> m.Reply:
        """Send the racket back to rest."""
        return self.ask(lambda number: m.RestRacket(id=number))

    def pause(self) -> m.Reply:
        """Stop the simulated clock."""
        return self.ask(lambda number: m.Pause(id=number))

    def resume(self) -> m.Reply:
        """Resume the simulated clock."""
        return self.ask(lambda number: m.Resume(id=number))

    def step(self, blocks: int = 1) -> m.Reply:
        """Run some blocks, then pause."""
        return self.ask(lambda number: m.SingleStep(id=number, blocks=blocks))

    def set_speed(self, factor: float) -> m.Reply:
        """Simulated seconds per second."""
        return self.ask(lambda number: m.SetSpeed(id=number, factor=factor))

    def set_noise(self, noise_hz: float) -> m.Reply:
        """Background events per pixel and second."""
        return self.ask(lambda number: m.SetNoise(id=number, noise_hz=noise_hz))

    def set_scene(self, scene: str) -> m.Reply:
        """What the cameras look at: a name of `core.simulation.scenes.scene.SCENES`."""
        patience_s = max(SCENE_S, self._timeout_s)
        return self.ask(lambda number: m.SetScene(id=number, scene=scene), timeout_s=patience_s)

    def auto_serve(self, speed_mps: float) -> m.Reply:
        """Serve repeatedly at this speed; 0 stops."""
        return self.ask(lambda number: m.AutoServe(id=number, speed_mps=speed_mps))

    def reset(self, seed: int | None = None) -> m.Reply:
        """Begin a new session."""
        return self.ask(lambda number: m.Reset(id=number, seed=seed))

    def ask(self, command: Callable[[int], object], timeout_s: float | None = None) -> m.Reply:
        """The answer to a command made for a number, in the client's time-out or another. Any thread may ask.

        Raises:
            LinkError: if the server refuses, is of another version, or does not answer in time.
        """
        with self._asking:
            number = next(self._numbers)
            if self._socket is None:
                self._socket = self._context.socket(zmq.DEALER)
                self._socket.setsockopt(zmq.LINGER, 0)
                self._socket.setsockopt(zmq.MAXMSGSIZE, m.COMMAND_BYTES)
                secure(self._socket, self._keys)
                self._watch = HandshakeWatch(self._socket, self._keys)
                self._socket.connect(self._commands_address)
            until_s = time.monotonic() + (timeout_s or self._timeout_s)
            self._socket.setsockopt(zmq.SNDTIMEO, _ms_until(until_s))
            with contextlib.suppress(zmq.Again):  # a refused client cannot send any more
                self._socket.send(m.encode(command(number)))
            while self._socket.poll(_ms_until(until_s)):
                reply = m.decode(self._socket.recv(), {"reply": m.Reply})
                if reply.id not in (0, number):
                    continue
                if reply.preparing is not None:
                    raise NotReadyError(reply.error, share=reply.preparing, where=self.address)
                if not reply.ok:
                    raise LinkError(reply.error, where=self.address)
                return reply
            refused = self._watch is not None and self._watch.refused()
            self._drop_socket()  # the command must not reach a later server
        if refused:
            remedy = "give --keys the folder that `rallyscope sim-server --make-keys` made for this client"
            raise RefusedError("a server is there, but its keys and ours do not fit", where=self.address, remedy=remedy)
        remedy = "start one with `rallyscope sim-server`"
        raise NoAnswerError("no answer from a simulation server", where=self.address, remedy=remedy)

    def close(self) -> None:
        """Disconnect."""
        self._stop.set()
        self._thread.join()
        with self._asking:
            self._drop_socket()
            self._context.destroy(linger=0)

    def _shake_hands(self, preparing: Callable[[float], None]) -> m.Reply:
        """Handshake; a compiling server replies so, and one that is just starting at least listens."""
        silent_until_s = time.monotonic() + SILENT_S
        while True:
            try:
                return self.ask(lambda number: m.Hello(id=number), timeout_s=min(HELLO_S, self._timeout_s))
            except NotReadyError as error:
                preparing(error.share)
                silent_until_s = time.monotonic() + SILENT_S
                time.sleep(ASK_AGAIN_S)
            except NoAnswerError:
                if time.monotonic() > silent_until_s or not self._somebody_listens():
                    raise

    def _somebody_listens(self) -> bool:
        host, _, port = self._commands_address.removeprefix("tcp://").rpartition(":")
        try:
            with socket.create_connection((host.strip("[]"), int(port)), timeout=min(HELLO_S, self._timeout_s)):
                return True
        except OSError:
            return False

    def _drop_socket(self) -> None:
        if self._watch is not None:
            self._watch.close()
            self._watch = None
        if self._socket is not None:
            self._socket.close(0)
            self._socket = None

    def _receive(self) -> None:
        # XSUB, not SUB, which would drop what was under way when a topic was given up.
        socket = self._context.socket(zmq.XSUB)
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.RCVHWM, 1000)
        socket.setsockopt(zmq.MAXMSGSIZE, m.MESSAGE_BYTES)
        socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
        secure(socket, self._keys)
        socket.connect(self.address)
        subscribed: frozenset[bytes] = frozenset()
        try:
            while not self._stop.is_set():
                wanted = self._topics()
                # Pictures first, so that no block comes without its own.
                for topic in sorted(wanted - subscribed, reverse=True):
                    socket.send(SUBSCRIBE + topic)
                for topic in subscribed - wanted:
                    socket.send(UNSUBSCRIBE + topic)
                subscribed = wanted
                if not socket.poll(100):
                    continue
                parts = socket.recv_multipart()
                try:
                    self._dispatch(m.decode(parts[-1], m.KINDS), only_alive=parts[0] == m.ALIVE)
                except LinkError as error:
                    self.rejected_messages += 1
                    logger.debug("ignored: %s", error)
        finally:
            socket.close(0)

    def _topics(self) -> frozenset[bytes]:
        """What is to be subscribed to: pictures where the server has some and a listener takes them."""
        if not self._listening:
            return frozenset({m.ALIVE})
        pictures = self.welcome.frame_cameras and self._listeners.want_pictures
        return frozenset({m.EVERYTHING, m.PICTURES} if pictures else {m.EVERYTHING})

    def _dispatch(
        self, message: m.WorldState | m.EventBatch | m.PictureMessage | m.Notice, *, only_alive: bool
    ) -> None:
        if isinstance(message, m.Reply):
            raise LinkError("a reply was published")
        self._received_s = time.monotonic()
        self._has_received.set()
        welcome = self.welcome
        fresh = message.session != welcome.session
        if fresh:
            welcome = self.ask(lambda number: m.Hello(id=number))
            if welcome.session != message.session:
                return  # from an earlier session
        with self._lock:
            if fresh:
                self.welcome, self._last_seq = welcome, 0
                self._listeners.on_session(welcome)
            if isinstance(message, m.PictureMessage):  # they have numbers of their own
                self._listeners.on_picture(message)
                return
            if only_alive and not self._listening:
                self._last_seq = 0  # who hears only signs of life misses the numbers between them
            if self._last_seq:
                self.lost_messages += max(0, message.seq - self._last_seq - 1)
            if self._last_seq or not only_alive:
                self._last_seq = message.seq
            if isinstance(message, m.EventBatch):
                self._listeners.on_events(message)
            elif isinstance(message, m.WorldState):
                self._listeners.on_state(message)
                self.state = message
            else:
                self._listeners.on_notice(message)


def _ms_until(until_s: float) -> int:
    return max(0, round((until_s - time.monotonic()) * 1e3))
