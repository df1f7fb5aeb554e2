"""The simulation as a server: publishes blocks, takes commands, and keeps to wall time.

While it compiles, a thread answers every command with "preparing" and how far it is.
"""

from __future__ import annotations

import dataclasses
import functools
import logging
import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import zmq

from core.cameras import Camera
from core.config import check_settings, setting
from core.errors import LinkError, RallyscopeError
from core.events import SensorSize
from core.jit import kernels_ready
from core.live.link import messages as m
from core.live.link.adaptive_rate import AdaptiveRate
from core.live.link.guard import LinkGateway, ServerKeys, check_reach, split_address
from core.live.link.published import contact_notice, event_batch, outcome_notice, published_ball_rows, serve_notice
from core.live.worlds.world import Block, SimulatedWorld, WorldConfig
from core.physics.episode import Case
from core.simulation.episodes.incoming import RecordedServes
from core.simulation.episodes.racket import RacketTarget
from core.simulation.event_cameras.event_camera import BLOCK_US
from core.simulation.scenes.scene import name_of_scene, scene_named
from core.simulation.sensor.readout import ReadoutCounts

logger = logging.getLogger(__name__)

LOOK_EVERY_MS: Final = 100
COMPILED: Final = ("core.physics", "core.simulation")
"""Packages with nearly all kernels of a simulation."""
KernelProgress = Callable[[int, int], None]
"""Called with the kernels that are ready and those that there are, whenever more are ready."""


class PreparingResponder:
    """Answers every command with "preparing" on a thread of its own, which alone uses the socket until `stop`."""

    def __init__(self, commands: zmq.Socket, on_progress: KernelProgress = lambda ready, known: None) -> None:
        """`commands` is the bound ROUTER socket."""
        self._commands, self._on_progress = commands, on_progress
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="preparing", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Release the socket; may be called again."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        reported = 0
        while not self._ended.is_set():
            ready, known = kernels_ready(*COMPILED)
            if ready > reported:
                reported = ready
                self._on_progress(ready, known)
            if self._commands.poll(LOOK_EVERY_MS):
                *envelope, data = self._commands.recv_multipart()
                self._commands.send_multipart([*envelope, m.encode(_reply(data, ready, known))], zmq.NOBLOCK)


def _reply(data: bytes, ready: int, known: int) -> m.Reply:
    try:
        number = m.decode(data, m.COMMANDS, m.COMMAND_BYTES).id
    except LinkError as error:
        logger.debug("ignored: %s", error)
        number = 0
    share = min(1.0, ready / known) if known else 0.0
    error = f"the simulation is being prepared: {ready} of about {known} kernels are ready"
    return m.Reply(
        id=number, ok=False, error=error, session="", t_us=0, block_us=BLOCK_US, seed=0, cameras=(), preparing=share
    )


SENSOR: Final = SensorSize(64, 48)
BLOCKS: Final = 120
"""Simulated time of 1.2 s: a ball flies into the racket, back over the net, and to the floor."""
BEFORE_RACKET_M: Final = np.array([0.5, 0.0, 0.1])
SPEED_MPS: Final = 6.0


def prepare_simulation(config: WorldConfig, cameras: Mapping[str, Camera]) -> None:
    """Play two balls in small pictures, so that all that a rally needs is compiled; nothing else comes of it."""
    small = {name: dataclasses.replace(camera, sensor=SENSOR, K=_scaled(camera)) for name, camera in cameras.items()}
    world = SimulatedWorld(config, small, seed=0)
    try:
        world.draw_serve(5.0)
        for number in range(BLOCKS):
            if number == BLOCKS // 4:
                start_m = world.rally.racket.p_m + BEFORE_RACKET_M
                world.serve(start_m, (-SPEED_MPS, 0.0, 0.0), (0.0, 0.0, 0.0))
            published_ball_rows(world.advance())
    finally:
        world.close()


def _scaled(camera: Camera) -> np.ndarray:
    """Camera matrix (3, 3) of the same view in the small picture."""
    scale = SENSOR.width_px / camera.sensor.width_px
    return camera.K * np.array([[scale], [scale], [1.0]])


HEARTBEAT_S: Final = 0.1
LATE_S: Final = 0.4
"""A delay above this is given up; a smaller one is caught up."""
AUTO_SERVE_PAUSE_US: Final = 300_000
TRIES: Final = 50
COMMANDED_S: Final = 10.0
"""Time after a command during which the server counts as used without a subscriber."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerConfig:
    """Settings of the simulated world and its publication."""

    world: WorldConfig = field(default_factory=WorldConfig)
    auto_serve_mps: float = setting(0.0, 0.0, 9.0)
    """Speed of automatic serves, 3 to 9 m/s; 0: only on command."""
    queue_messages: int = setting(300, 10, 10_000)
    """Messages kept for a slow subscriber, about one second; what is beyond is dropped, and shows in `seq`."""

    def __post_init__(self) -> None:
        check_settings(self)


class SimulationServer:
    """Publishes on a port and takes commands on the next one. `run` it in the thread that made it.

    From the moment it has its ports until it runs it answers that it is being prepared. Time stands still while nobody
    is there, and goes on where it stopped with the next subscriber or command: a simulation for nobody would only take
    the processor from others. Who subscribes to nothing but signs of life is nobody.
    """

    def __init__(
        self,
        config: ServerConfig,
        cameras: Mapping[str, Camera],
        address: str,
        *,
        seed: int = 0,
        recorded: RecordedServes | None = None,
        preparing: KernelProgress = lambda ready, known: None,
        keys: ServerKeys | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Port 0 takes any two free ports. With `recorded`, the balls that are drawn are of those.

        `preparing` hears, from another thread, how far the compiler is. With `keys` only their clients are served.
        `clock` is the wall time that the simulation keeps to, s.

        Raises:
            LinkError: if the ports cannot be had, or others could reach them without keys.
        """
        check_reach(split_address(address)[0], keys)
        self._config, self._cameras, self._recorded, self._clock = config, dict(cameras), recorded, clock
        self._context = zmq.Context()
        self._gateway = LinkGateway(self._context, keys)
        self.rejected = 0
        """Number of invalid commands."""
        self._topics: Counter[bytes] = Counter()
        """Topic -> how many subscribers want it."""
        self._commanded_s = float("-inf")
        self._speed, self._paused, self._steps = 1.0, False, 0
        self._noise_hz = config.world.stereo.sensor.noise_hz
        self._auto_mps, self._scene = config.auto_serve_mps, config.world.stereo.scene
        try:
            self.address = self._bind(address)
        except LinkError:
            self._gateway.close()
            self._context.destroy(linger=0)
            raise
        # Answers clients while the kernels compile, so that nobody takes the server for dead.
        self._responder = PreparingResponder(self._commands, preparing)
        try:
            self._start_session(seed)
        except BaseException:
            self._hang_up()
            raise

    @property
    def attended(self) -> bool:
        """Whether there is a subscriber or a recent command."""
        return bool(self._topics.keys() - {m.ALIVE}) or self._clock() - self._commanded_s < COMMANDED_S

    def prepare(self) -> None:
        """Compile all that a rally needs, if this machine has not done so before."""
        prepare_simulation(self._config.world, self._cameras)

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve until `stopped`; looks at it at least ten times a second."""
        self._responder.stop()
        self._anchor()
        try:
            while not stopped():
                self._turn()
        finally:
            self.close()

    def close(self) -> None:
        """Close the ports."""
        self._world.close()
        self._hang_up()

    def _hang_up(self) -> None:
        self._responder.stop()
        self._gateway.close()
        self._context.destroy(linger=0)

    def _bind(self, address: str) -> str:
        host, port = split_address(address)
        problem: zmq.ZMQError | None = None
        for _ in range(1 if port else TRIES):
            self._published, self._commands = self._context.socket(zmq.XPUB), self._context.socket(zmq.ROUTER)
            self._published.setsockopt(zmq.XPUB_MANUAL, 1)
            self._published.setsockopt(zmq.SNDHWM, self._config.queue_messages)
            self._commands.setsockopt(zmq.MAXMSGSIZE, 16 * m.COMMAND_BYTES)  # limit of a message's size
            self._commands.setsockopt(zmq.RCVHWM, 1000)
            self._published.setsockopt(zmq.MAXMSGSIZE, m.COMMAND_BYTES)  # it receives subscriptions only
            for socket in (self._published, self._commands):
                socket.setsockopt(zmq.LINGER, 0)
                self._gateway.guard(socket)
            try:
                self._published.bind(f"tcp://{host}:{port or '*'}")
                bound = int(bytes(self._published.getsockopt_string(zmq.LAST_ENDPOINT), "ascii").rpartition(b":")[2])
                self._commands.bind(f"tcp://{host}:{bound + 1}")
                return f"tcp://{host}:{bound}"
            except zmq.ZMQError as error:
                problem = error
                self._published.close(0)
                self._commands.close(0)
        remedy = "end what uses the ports (this one and the next), or choose others"
        raise LinkError(f"cannot listen ({problem})", got=address, remedy=remedy) from problem

    def _start_session(self, seed: int) -> None:
        self._session = uuid.uuid4().hex
        self._seq = self._served = self._returned = 0
        stereo = dataclasses.replace(self._config.world.stereo, scene=self._scene)
        world = dataclasses.replace(self._config.world, stereo=stereo)
        self._world = SimulatedWorld(world, self._cameras, seed, recorded=self._recorded)
        self._world.set_noise(self._noise_hz)
        self._anchor()
        self._unpublished: Block | None = None
        self._quiet_since_us = -AUTO_SERVE_PAUSE_US
        self._beat_s = self._alive_s = 0.0
        self._factor = 0.0
        self._pace = AdaptiveRate()

    def _anchor(self) -> None:
        """Set the current simulated time as the reference for wall time."""
        self._anchor_s, self._anchor_us = self._clock(), self._world.now_us

    def _due_s(self, t_us: int) -> float:
        return self._anchor_s + (t_us - self._anchor_us) * 1e-6 / (self._speed * self._pace.share)

    def _turn(self) -> None:
        """One block, or a short wait for commands while paused. A block is computed while it lasts."""
        self._hear_of_subscribers()
        self._take_commands(self._clock())  # before the look at the pause: one that is answered here begins no block
        if not self.attended or (self._paused and not self._steps):
            self._take_commands(self._clock() + HEARTBEAT_S / 2)
            self._beat()
            self._anchor()
            return
        if self._unpublished is not None:
            block, self._unpublished = self._unpublished, None
            self._publish(block)
        self._serve_by_itself()
        session, began_s = self._session, self._clock()
        block = self._world.advance()
        spent_s = max(self._clock() - began_s, 1e-6)
        self._factor = (
            0.9 * self._factor + 0.1 * BLOCK_US * 1e-6 / spent_s if self._factor else BLOCK_US * 1e-6 / spent_s
        )
        if self._steps:
            self._steps -= 1
            self._anchor()
        else:
            while (due_s := self._due_s(block.end_us)) > self._clock() and not self._paused:
                self._take_commands(min(due_s, self._clock() + HEARTBEAT_S))
                if self._session != session:
                    return
                if due_s > self._clock() + HEARTBEAT_S:
                    self._beat()
            if self._clock() - due_s > LATE_S:
                self._anchor()
        self._hear_of_subscribers()
        if not self.attended:  # the last one left while the block was computed: who comes next gets it
            self._unpublished = block
            return
        self._publish(block)
        if not self._paused:
            self._keep_pace(spent_s, self._clock() - began_s)

    def _keep_pace(self, spent_s: float, passed_s: float) -> None:
        """Adapt the rate to this machine; above real time it runs as fast as possible."""
        if self._speed <= 1.0 and self._pace.note(
            BLOCK_US * 1e-6 / (self._speed * self._pace.share), spent_s, passed_s
        ):
            self._anchor()

    def _hear_of_subscribers(self) -> None:
        """Take subscriptions and their ends; between two blocks only, so that the last one of who leaves is whole."""
        while self._published.poll(0):
            wanted = self._published.recv()
            topic, ends = wanted[1:], wanted[:1] == b"\x00"
            for one in m.ALL_BUT_PICTURES if topic == m.EVERYTHING else (topic,):
                self._published.setsockopt(zmq.UNSUBSCRIBE if ends else zmq.SUBSCRIBE, one)
            self._topics[topic] += -1 if ends else 1
        self._topics = +self._topics  # without those that nobody wants

    def _serve_by_itself(self) -> None:
        if self._world.ball_is_visible:
            self._quiet_since_us = self._world.now_us
        elif self._auto_mps and self._world.now_us - self._quiet_since_us >= AUTO_SERVE_PAUSE_US:
            self._serve(m.Serve(id=0, speed_mps=self._auto_mps))

    def _publish(self, block: Block) -> None:
        for name in block.events:
            self._send("events", event_batch(block, name, self._session, self._next()))
        for contact in block.contacts:
            self._send(contact.event.kind, contact_notice(contact, self._session, self._next()))
        for judged in block.outcomes:
            self._returned += judged.outcome.case == Case.RETURNED
            self._send("outcome", outcome_notice(judged, self._session, self._next()))
        self._send("state", self._state(block))
        if m.ALIVE in self._topics and self._clock() - self._alive_s >= HEARTBEAT_S:
            self._send_alive()

    def _state(self, block: Block | None) -> m.WorldState:
        world, no_times = self._world, np.empty(0, np.int64)
        readout = functools.reduce(ReadoutCounts.plus, world.readout.values())
        ball = np.empty((0, 9)) if block is None else published_ball_rows(block)
        if not world.ball_is_visible:
            phase = "idle"
        else:
            phase = "decided" if not world.pending else "return" if world.struck else "serve"
        return m.WorldState(
            session=self._session,
            seq=self._next(),
            wall_ns=time.time_ns(),
            start_us=world.now_us if block is None else block.start_us,
            t_us=world.now_us if block is None else block.end_us,
            phase=phase,
            paused=self._paused,
            speed_factor=self._speed,
            noise_hz=self._noise_hz,
            auto_serve_mps=self._auto_mps,
            real_time_factor=self._factor,
            served=self._served,
            returned=self._returned,
            scene=name_of_scene(self._scene),
            readout_delayed=readout.delayed,
            readout_dropped=readout.dropped,
            readout_longest_us=readout.longest_us,
            kept_share=self._pace.share,
            ball_t_us=no_times if block is None else block.ball.t_us,
            ball=ball,
            ball_visible=np.empty(0, np.uint8) if block is None else block.ball.visible.view(np.uint8),
            racket_t_us=no_times if block is None else block.racket_t_us,
            racket=np.empty((0, 10)) if block is None else block.racket,
        )

    def _next(self) -> int:
        self._seq += 1
        return self._seq

    def _send(self, topic: str, message: object) -> None:
        self._published.send_multipart([topic.encode(), m.encode(message)])  # PUB drops messages instead of waiting
        self._beat_s = self._clock()

    def _beat(self) -> None:
        if self._clock() - self._beat_s >= HEARTBEAT_S:
            # While a block waits for its time the world is ahead of what was published: no rows, only a sign of life.
            self._send_alive()

    def _send_alive(self) -> None:
        self._published.send_multipart([m.ALIVE, m.encode(self._state(None))])
        self._beat_s = self._alive_s = self._clock()

    def _take_commands(self, until_s: float) -> None:
        """Answer pending commands, and those that arrive until a time."""
        while self._commands.poll(max(0, round((until_s - self._clock()) * 1e3))):
            *envelope, data = self._commands.recv_multipart()
            reply = self._answer(data)
            self._commands.send_multipart([*envelope, m.encode(reply)], zmq.NOBLOCK)

    def _answer(self, data: bytes) -> m.Reply:
        try:
            command = m.decode(data, m.COMMANDS, m.COMMAND_BYTES)
        except LinkError as error:
            self.rejected += 1
            return self._reply(0, str(error)[:1000])
        if not isinstance(command, m.Hello):  # a handshake does not count as use
            self._commanded_s = self._clock()
        try:
            self._obey(command)
        except RallyscopeError as error:
            return self._reply(command.id, str(error)[:1000])
        return self._reply(command.id, "", hello=isinstance(command, m.Hello))

    def _reply(self, number: int, error: str, *, hello: bool = False) -> m.Reply:
        cameras = tuple(m.CameraInfo.of(name, camera) for name, camera in self._cameras.items()) if hello else ()
        world = self._world
        return m.Reply(
            id=number, ok=not error, error=error, session=self._session, t_us=world.now_us, block_us=BLOCK_US,
            seed=world.seed, cameras=cameras, physics=world.config.task.physics if hello else None,
        )  # fmt: skip

    def _obey(self, command: object) -> None:
        match command:
            case m.Serve():
                self._serve(command)
            case m.AimRacket():
                p, q, v = (np.array(item) for item in (command.p_m, command.q_wxyz, command.v_mps))
                self._world.aim(RacketTarget(p, q, v, command.t_us * 1e-6))
            case m.RestRacket():
                self._world.aim(None)
            case m.Pause():
                self._paused, self._steps = True, 0
            case m.Resume():
                self._paused, self._steps = False, 0
                self._anchor()
            case m.SingleStep():
                self._paused, self._steps = True, command.blocks
            case m.SetSpeed():
                self._speed = command.factor
                self._pace.ask_anew()
                self._anchor()
            case m.SetNoise():
                self._world.set_noise(command.noise_hz)
                self._noise_hz = command.noise_hz
            case m.SetScene():
                self._scene = scene_named(command.scene)
                self._world.set_scene(self._scene)
                self._pace.ask_anew()
                self._anchor()
            case m.AutoServe():
                self._auto_mps = command.speed_mps
            case m.Reset():
                seed = self._world.seed if command.seed is None else command.seed
                self._world.close()
                self._steps = 0  # those that are left are of the session that ends
                self._start_session(seed)

    def _serve(self, command: m.Serve) -> None:
        if command.p_m is None or command.v_mps is None:
            event = self._world.draw_serve(command.speed_mps)
        else:
            event = self._world.serve(command.p_m, command.v_mps, command.spin_radps or (0.0, 0.0, 0.0))
        self._served += 1
        self._send("serve_notice", serve_notice(event, self._session, self._next()))
