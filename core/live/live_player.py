"""Player of a live rally: runs the chain on a source's events, and commands the racket if there is one.

It works on a thread of its own, so that neither the link nor a picture waits for it. Blocks that it cannot follow are
dropped, the oldest first, and counted. It survives the end of a session and goes on with the next one.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from core.cameras import Camera
from core.chain.chain import RallyChain
from core.chain.config import WINDOW_US, ChainConfig, HitRule, chain_for_physics, expected_physics
from core.chain.control.controller import BuiltInController, LiveController, RacketDecision
from core.chain.control.player import Player, PlayerState
from core.chain.control.step_test import CommandLatency
from core.chain.follow import add_pictures
from core.config import check_settings, setting
from core.detection import Detector
from core.detection.window import block_windows
from core.errors import ConfigError, LinkError, RallyscopeError
from core.live.link import messages as m
from core.live.link.live_source import LimitedRobot, LiveSource
from core.live.live_flight import CommandSender, LiveFlight, QueuedCommand
from core.live.live_pictures import LiveFrameCameras
from core.live.live_snapshot import FinishedBall, LiveMeter, RallySnapshot
from core.live.urgency import freeze_loaded, go_first
from core.live.warm_up import load_strokes, warm_up
from core.physics.config import PhysicsConfig
from core.recordings.frames import FrameStream
from core.simulation.event_cameras.event_camera import BLOCK_US

MAX_WAITING: Final = 8
"""Blocks of 10 ms; older ones are dropped: a prediction from them would come too late."""
MOST_PICTURES: Final = 64
"""Most pictures of one block; there are more only where the messages that end blocks are lost."""
NOBODY: Final = "nothing has been heard of the source yet"


@dataclass(frozen=True, slots=True, kw_only=True)
class LivePlayerConfig:
    """Settings of the live player."""

    chain: ChainConfig = field(default_factory=ChainConfig)
    window_us: int = setting(WINDOW_US, 200, 10_000)
    """Length of a window of events, a whole part of a block."""
    hit: HitRule = "chosen"
    """Where the ball is met: `chosen` along its flight, or always at the `paper`'s plane. Before a robot that states no
    limits it is always the plane."""
    knows_physics: bool = False
    """Whether chain and controller get the simulation's exact physics; otherwise they learn it."""

    def __post_init__(self) -> None:
        check_settings(self)
        if BLOCK_US % self.window_us:
            expected = f"a divisor of {BLOCK_US} us, such as 1000, 2000 or 2500"
            raise ConfigError("windows do not fill a block", expected=expected, got=self.window_us, where="window_us")


@dataclass(frozen=True, slots=True, eq=False)
class _ReceivedBlock:
    """A complete block."""

    state: m.WorldState
    batches: tuple[m.EventBatch, ...]
    pictures: tuple[m.PictureMessage, ...]
    arrived_s: float
    """Arrival on the monotonic clock, s."""
    late_s: float
    """Delay from the sender's clock to its arrival; meaningful only on one machine."""
    resumes: bool
    """Whether it is the first one after a pause without listeners: none is missing before it."""


_Item = m.Reply | _ReceivedBlock | m.Notice
StateListener = Callable[[str, PlayerState, RacketDecision | None], None]
BallListener = Callable[[FinishedBall], None]


class LivePlayer:
    """Plays the rally of a source until it is closed. Thread-safe."""

    def __init__(
        self,
        source: LiveSource,
        controller: LiveController | None = None,
        config: LivePlayerConfig | None = None,
        *,
        playing: bool = True,
        frame_detector: Callable[[], Detector] | None = None,
    ) -> None:
        """Begin as soon as everything is loaded; without `playing`, or a robot, it only watches and sends nothing.

        `frame_detector` makes the detector of each calibrated frame camera; without one pictures are not looked at.
        """
        self._source = source
        self._physics = source.physics
        self._config = config or LivePlayerConfig()
        self._controller = self._with_physics(controller or BuiltInController())
        self._new_config = False
        self._latency: CommandLatency | None = None
        self._playing = playing and source.robot is not None
        self._changed = threading.Condition()
        self._waiting: deque[_Item] = deque()
        self._blocks_waiting = 0
        self._just_dropped = 0  # dropped between the last block played and the next one
        self._woken = self._just_resumed = False  # the next block to arrive, or one of those just dropped, resumes
        self._stop = False
        self._pending: dict[int, list[m.EventBatch]] = {}  # the link's thread only
        self._pictures: deque[m.PictureMessage] = deque(maxlen=MOST_PICTURES)  # the link's thread only
        self._session, self._cameras = "", {}
        self._frame_cameras = LiveFrameCameras(frame_detector)
        self._player: Player | None = None
        self._problem = NOBODY
        self._meter = LiveMeter()
        self._flight = LiveFlight()
        self._listeners: tuple[StateListener, ...] = ()
        self._step_listeners: tuple[StateListener, ...] = ()
        self._ball_listeners: tuple[BallListener, ...] = ()
        self._sender = None if source.robot is None else CommandSender(source, source.robot)
        self._number = itertools.count(1)
        self._snapshot = self._flight.snapshot(0, "", self._controller, self._playing, self._meter, NOBODY)
        self._thread = threading.Thread(target=self._run, name="live-player", daemon=True)
        self._thread.start()

    @property
    def snapshot(self) -> RallySnapshot:
        """Newest snapshot; there is one per block, a hundred per simulated second."""
        return self._snapshot

    @property
    def meter(self) -> LiveMeter:
        """Counters of this session; the benchmarks read them."""
        return self._meter

    @property
    def controller(self) -> LiveController:
        """Current controller."""
        return self._controller

    @property
    def config(self) -> LivePlayerConfig:
        """Config of the chain."""
        return self._config

    @property
    def playing(self) -> bool:
        """Whether commands are sent."""
        return self._playing

    @property
    def idle(self) -> bool:
        """Whether every racket command of the newest snapshot has been answered, if there is a robot."""
        return self._sender is None or self._sender.idle

    def use(self, controller: LiveController) -> None:
        """Use another controller from the next block on; it gets the same knowledge of the physics as the player."""
        self._controller = self._with_physics(controller)

    def aim_at(self, goal_m: tuple[float, float]) -> None:
        """Change the landing target of the controller.

        Raises:
            ConfigError: if it cannot aim there.
        """
        self._controller = self._controller.aimed_at(goal_m)

    @property
    def latency(self) -> CommandLatency | None:
        """Measured latency of the robot's commands, which are sent that much earlier; None if never measured."""
        return self._latency

    def lead_by(self, latency: CommandLatency) -> None:
        """Set the racket's latency, by which commands are sent earlier, from the next block on."""
        self._latency = latency

    def configure(self, config: LivePlayerConfig) -> None:
        """Follow the ball with other settings, from the next block on."""
        with self._changed:
            self._config, self._new_config = config, True

    def play(self, playing: bool) -> None:
        """Send commands, or only watch; without a robot it only watches."""
        self._playing = playing and self._source.robot is not None

    def wake(self) -> None:
        """Go on after a pause in which nobody listened to the source: blocks of that time are not missing."""
        with self._changed:
            self._woken = True

    def add_listener(self, listener: StateListener) -> None:
        """Add a listener for every new prediction, in the player's thread: session, state, decision if one was sent."""
        self._listeners = (*self._listeners, listener)

    def distrust(self, camera: str | None, off_px: float) -> None:
        """See `RallyChain.distrust`; for step listeners, which are called in the thread of the chain."""
        if self._player is not None:
            self._player.chain.distrust(camera, off_px)

    def add_step_listener(self, listener: StateListener) -> None:
        """Add a listener for every step, also without a new prediction."""
        self._step_listeners = (*self._step_listeners, listener)

    def add_ball_listener(self, listener: BallListener) -> None:
        """Add a listener for outcomes of balls, if the source reports them; called in the player's thread."""
        self._ball_listeners = (*self._ball_listeners, listener)

    def remove_listener(self, listener: StateListener) -> None:
        """Remove a listener."""
        self._listeners = tuple(one for one in self._listeners if one != listener)

    def close(self) -> None:
        """Stop the threads. The source stays open."""
        with self._changed:
            self._stop = True
            self._changed.notify()
        self._thread.join()
        self._source.remove_listener(self)
        if self._sender is not None:
            self._sender.close()

    # Callbacks of the link, in its thread: they only queue.

    def on_session(self, welcome: m.Reply) -> None:
        """Reset for a new session; queued blocks are dropped."""
        with self._changed:
            self._pending.clear()
            self._pictures.clear()
            self._waiting.clear()
            self._blocks_waiting = self._just_dropped = 0
            self._just_resumed = False
            self._waiting.append(welcome)
            self._changed.notify()

    def on_events(self, batch: m.EventBatch) -> None:
        """Keep it until its block is complete."""
        self._pending.setdefault(batch.start_us, []).append(batch)

    def on_picture(self, picture: m.PictureMessage) -> None:
        """Keep it until its block is complete."""
        self._pictures.append(picture)

    def on_state(self, state: m.WorldState) -> None:
        """The block is complete; the oldest one that waits is dropped when there are too many."""
        if not state.ends_block:
            return
        batches = tuple(self._pending.pop(state.start_us, ()))
        pictures = tuple(self._pictures)
        self._pending.clear()
        self._pictures.clear()
        arrived_s, late_s = time.monotonic(), (time.time_ns() - state.wall_ns) * 1e-9
        with self._changed:
            if self._blocks_waiting >= MAX_WAITING:
                self._drop_oldest()
            self._waiting.append(_ReceivedBlock(state, batches, pictures, arrived_s, late_s, self._woken))
            self._woken = False
            self._blocks_waiting += 1
            self._changed.notify()

    def on_notice(self, notice: m.Notice) -> None:
        """Queue a notice in order with the blocks."""
        with self._changed:
            self._waiting.append(notice)
            self._changed.notify()

    def _drop_oldest(self) -> None:
        for index, item in enumerate(self._waiting):
            if isinstance(item, _ReceivedBlock):
                del self._waiting[index]
                self._blocks_waiting -= 1
                self._just_dropped += 1
                self._just_resumed |= item.resumes
                self._meter.dropped += 1
                self._meter.note_pictures(self._frame_cameras.count(item.pictures), looked_at=False)
                return

    # The player's own thread.

    def _run(self) -> None:
        go_first()
        self._warm_up()
        freeze_loaded()
        self._source.add_listener(self)
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stop or self._waiting)
                if self._stop:
                    return
                item = self._waiting.popleft()
                self._blocks_waiting -= isinstance(item, _ReceivedBlock)
                counted = self._just_dropped
                if isinstance(item, _ReceivedBlock):
                    resumes, self._just_resumed = self._just_resumed or item.resumes, False
                    counted, self._just_dropped = None if resumes else counted, 0
                fresh, self._new_config = self._new_config, False
            # A new session is begun with the newest config anyway.
            if isinstance(item, m.Reply):
                self._begin(item)
            elif fresh:
                self._build()
            if isinstance(item, _ReceivedBlock):
                self._play(item, counted)
            elif isinstance(item, m.OutcomeNotice):
                ball = self._flight.finish(item, self._controller.goal_m)
                for listener in self._ball_listeners:
                    listener(ball)
            self._publish()

    def _warm_up(self) -> None:
        """Load compiled code before the first block."""
        try:
            cameras = self._source.welcome.calibrated()
            self._frame_cameras.begin_session(self._source.welcome)
            warm_up(self._make_player(cameras), cameras, self._config.window_us)
            self._frame_cameras.warm_up()
        except RallyscopeError as error:
            self._problem = str(error)

    def _begin(self, welcome: m.Reply) -> None:
        self._session, self._cameras = welcome.session, {}
        self._flight, self._meter = LiveFlight(), LiveMeter()
        if self._sender is not None:
            self._sender.begin_session(self._meter)
        self._physics = self._source.physics
        self._controller = self._with_physics(self._controller)
        try:
            self._cameras = welcome.calibrated()
            self._frame_cameras.begin_session(welcome)
        except LinkError as error:
            self._player, self._problem = None, str(error)
            return
        self._build()

    def _build(self) -> None:
        self._player, self._problem = None, ""
        if self._config.hit == "chosen":
            load_strokes()
        try:
            self._player = self._make_player(self._cameras)
        except RallyscopeError as error:
            self._problem = str(error)

    def _make_player(self, cameras: Mapping[str, Camera]) -> Player:
        frames = self._frame_cameras
        chain = RallyChain({**cameras, **frames.cameras}, self._chain_config(), frames.detectors())
        return Player(chain, self._controller, hit=self._config.hit)

    def _chain_config(self) -> ChainConfig:
        """Chain config: with the known physics if `knows_physics`, else it learns them."""
        physics = self._physics if self._config.knows_physics else None
        return self._config.chain if physics is None else chain_for_physics(self._config.chain, physics)

    def _with_physics(self, controller: LiveController) -> LiveController:
        physics = self._physics or PhysicsConfig()
        return controller.for_physics(physics if self._config.knows_physics else expected_physics(physics))

    def _play(self, block: _ReceivedBlock, counted: int | None) -> None:
        """Process a block; of the missing blocks before it, `counted` were dropped here, the others never came.

        None: nobody listened before it, so that none is missing.
        """
        state, player = block.state, self._player
        if state.session != self._session:
            return
        if counted is None:
            self._meter.resume()
        else:
            with self._changed:  # the link's thread counts too
                self._meter.dropped += max(0, self._flight.blocks_missing(state) - counted)
        self._flight.see(state)
        if player is None:
            return
        player.controller = self._controller
        self._inform_of_racket(player)
        if self._latency is not None:
            player.lead_by(self._latency)
        began_s = time.monotonic()
        try:
            events = {batch.camera: batch.events() for batch in block.batches if batch.camera in self._cameras}
        except LinkError as error:
            with self._changed:
                self._meter.dropped += 1
            self._problem = str(error)
            return
        decode_s = time.monotonic() - began_s
        windows_of = block_windows(events, state.start_us, state.t_us, self._config.window_us) if events else ()
        steps = tuple(add_pictures(windows_of, self._pictures_to_look_at(block)))
        newest: QueuedCommand | None = None
        for number, windows in enumerate(steps, 1):
            step = player.step(windows)
            playing = self._playing  # it may change meanwhile
            self._meter.note_step(step.chain.seconds.total + step.control_s)
            decision = self._flight.follow(step, playing=playing)
            if decision is not None:
                newest = self._order(decision, block, step, decode_s)
            # One command a block: what an earlier window decides is up to 8 ms older, and the newest would wait until
            # the robot has answered to it.
            if number == len(steps) and playing and newest is not None and self._sender is not None:
                self._sender.put(newest)
            self._inform_listeners(step, decision, playing=playing)
        self._meter.note_block()

    def _pictures_to_look_at(self, block: _ReceivedBlock) -> dict[str, FrameStream]:
        """Pictures of a block, by camera; none while others wait, or if it would take too long."""
        found = self._frame_cameras.streams(block.pictures)
        if not found:
            return {}
        state = block.state
        speed = 0.0 if state.paused else state.speed_factor * state.kept_share
        with self._changed:  # the link's thread counts too
            # A robot is not to wait for a try.
            fits = self._frame_cameras.has_time(found, speed, tries=not self._playing)
            looks = fits and not self._blocks_waiting
            self._meter.note_pictures(sum(map(len, found.values())), looked_at=looks)
        return found if looks else {}

    def _inform_of_racket(self, player: Player) -> None:
        """What the robot says of itself: its limits, and where it waits.

        Of a robot that states no limits, or has not yet, it is not known that it can go elsewhere than to the plane.
        """
        robot = self._source.robot
        reach = robot.reach if isinstance(robot, LimitedRobot) else None
        player.reach = reach or player.reach
        player.hit = self._config.hit if robot is None or reach is not None else "paper"
        racket = self._flight.racket
        player.rest_m = None if racket is None else racket.p_world_m

    def _inform_listeners(self, state: PlayerState, decision: RacketDecision | None, *, playing: bool) -> None:
        for listener in self._step_listeners:
            listener(self._session, state, decision)
        if state.chain.is_new:
            for listener in self._listeners:
                listener(self._session, state, decision if playing else None)

    def _order(
        self, decision: RacketDecision, block: _ReceivedBlock, step: PlayerState, decode_s: float
    ) -> QueuedCommand:
        state = block.state
        speed = state.speed_factor * state.kept_share
        rest_s = (state.t_us - decision.t_us) * 1e-6 / speed if speed else 0.0
        window_s = float("nan") if state.paused else block.arrived_s - block.late_s - rest_s
        return QueuedCommand(self._session, decision, window_s, block.arrived_s, decode_s, step, time.monotonic())

    def _publish(self) -> None:
        learned = None if self._player is None else self._player.chain.learned
        self._snapshot = self._flight.snapshot(
            next(self._number), self._session, self._controller, self._playing, self._meter, self._problem, learned
        )
