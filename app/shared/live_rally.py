"""The live rally of this app: one source, one player, shared by all browsers."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.background.child import ChildProcess, share_in
from app.shared.frame_detector import frame_detector
from app.shared.live_learning import LiveLearning
from core.cameras import Camera
from core.chain.calibration_drift import CalibrationDrift, DriftReport
from core.chain.config import HitRule, PredictionName, chain_with_constants, with_prediction
from core.chain.control.controller import RacketDecision
from core.chain.control.player import PlayerState
from core.chain.follow import frame_cameras
from core.detection import Detector
from core.errors import CommandError, LinkError, RecordingError
from core.history.played_bodies import PlayedBodies
from core.history.rally_history import Outcome, RallyHistory
from core.history.rally_picture import LandingSpot
from core.history.record_live import LiveRecorder, LiveRows
from core.history.seen_outcomes import BallConditions, ReturnCounts, SeenOutcomes
from core.live.link import messages as m
from core.live.link.client import SimulationClient
from core.live.link.guard import ClientKeys
from core.live.link.live_source import LiveSource, RecalibratedSource
from core.live.live_player import LivePlayer
from core.live.live_snapshot import RallySnapshot
from core.live.ring_recording import LiveConfig, RingRecording
from core.live.stream_watch import StreamWatch
from core.physics.constants_file import FittedConstants
from core.physics.episode import Case
from core.recordings.frames import FrameStream
from core.robot import RobotClient, SourceWithRobot
from core.robot.robot_step_test import RobotStepTest


class SimulationProcess:
    """The simulation's process; it starts at once, `wait` returns its address."""

    def __init__(self, *arguments: str, on_progress: Callable[[float], None] = lambda share: None) -> None:
        """`arguments` of the verb; `on_progress` gets the compiled share, 0 to 1."""
        self._address = ""
        self._started = threading.Event()
        self._on_progress = on_progress
        command = ("app.cli", "sim-server", "--bind", "tcp://127.0.0.1:0", "--until-eof", *arguments)
        self._child = ChildProcess(*command, on_line=self._hear, on_end=self._started.set)

    def wait(self) -> str:
        """Wait for its address; a slow machine may compile for minutes.

        Raises:
            LinkError: if it ends before.
        """
        self._started.wait()
        if not self._address:
            remedy = "run `rallyscope sim-server` to see why"
            raise LinkError("the simulation did not start", got=self._child.last_words, remedy=remedy)
        return self._address

    @property
    def is_alive(self) -> bool:
        """Whether the process has not ended."""
        return self._child.is_alive

    def stop(self) -> None:
        """End the simulation's process."""
        self._child.stop()

    def _hear(self, line: str) -> None:
        share = share_in(line)
        if share is not None:
            self._on_progress(share)
        elif "tcp://" in line and not self._address:
            self._address = line[line.index("tcp://") :].split()[0]
            self._started.set()


LIVE: Final = "live"
"""Name of the live rally in the list of recordings."""
REMEMBERED_S: Final = 20.0
BEHIND_US: Final = 300_000
"""A ball counts only if the player was no farther behind when it was served: it reaches the robot 0.5 s later."""
FORGET_EVERY_US: Final = 1_000_000


class LiveRally:
    """The live rally: receives a source, keeps its history, and plays. Thread-safe."""

    def __init__(
        self,
        source: LiveSource,
        *,
        process: SimulationProcess | None = None,
        robot: RobotClient | None = None,
        frame_detector: Callable[[], Detector] | None = None,
    ) -> None:
        """Listen to a source, which is closed with the rally; so are the `process` that it comes from, and the robot.

        `frame_detector` makes the detector of each calibrated frame camera; without one those are not followed.

        Raises:
            LinkError: if there is a `robot`, and the source has one of its own.
        """
        self._process = process
        self.source = source
        self.robot = robot
        """The external robot; the simulation's robot is part of its source."""
        self._source_with_robot = source if robot is None else SourceWithRobot(source, robot)
        self.simulation = source if isinstance(source, SimulationClient) else None
        """Interface of the simulation (serves, pause, scene); None if the source is not a simulation."""
        self.recording = RingRecording(LiveConfig(seconds=REMEMBERED_S))
        self.history = RallyHistory()
        self.rows = LiveRows()
        self.bodies = PlayedBodies()
        """Persons in the scene over time."""
        self.returns = ReturnCounts()
        """Returned balls since the app's start, over all sessions of the source."""
        self.watch = StreamWatch()
        """Watches for lost blocks, cameras and delays."""
        self._drift: CalibrationDrift | None = None
        self._outcome_classifier = None if source.has_outcomes else SeenOutcomes(self.history)
        self._scene: str | None = None
        self._session = ""
        self._recorder: LiveRecorder | None = None
        self.is_changing_scene = False
        """Whether the simulation is building another scene: until then no data arrives, as somebody asked for it."""
        self._recording_lock = threading.Lock()
        self._watched, self._awake = True, True
        self._keeping, self._keepers = threading.Lock(), 0
        self._forgotten_us = 0
        # In this order: when the rally hears of a block itself, the recording has it.
        source.add_listener(self.watch)
        source.add_listener(self.recording)
        self._follows_frames = frame_detector is not None
        self.player = LivePlayer(self._source_with_robot, frame_detector=frame_detector)
        self.step_test = None if robot is None else RobotStepTest(self.player, robot)
        """Measures the latency of the external robot."""
        self.learning = LiveLearning(self.player, robot=self.has_robot, outcomes=source.has_outcomes)
        """Online learning."""
        self._source_with_robot.add_listener(self)
        self.player.add_step_listener(self._on_step)

    @property
    def cameras(self) -> dict[str, Camera]:
        """The cameras of the present session, and the frame cameras that are followed."""
        known = {name: one.calibration for name, one in {**self.recording.cameras, **self.frames}.items()}
        return {name: camera for name, camera in known.items() if camera is not None}

    @property
    def frames(self) -> dict[str, FrameStream]:
        """Remembered pictures of the frame cameras that are followed, by camera."""
        return frame_cameras(self.recording) if self._follows_frames else {}

    @property
    def state(self) -> m.WorldState | None:
        """Newest state from the source."""
        return self.source.state

    @property
    def has_robot(self) -> bool:
        """Whether there is a robot; otherwise balls are only watched."""
        return self._source_with_robot.robot is not None

    @property
    def drift(self) -> DriftReport:
        """Report of the calibration drift in this session."""
        drift = self._drift
        return DriftReport() if drift is None else drift.report

    @property
    def simulation_lives(self) -> bool:
        """Whether the source is a simulation whose process is ours, and has not ended."""
        return self._process is not None and self._process.is_alive

    @property
    def recorded(self) -> Path | None:
        """File that is being recorded; None if none."""
        recorder = self._recorder  # read once: another thread may end it meanwhile
        return None if recorder is None else recorder.path

    @property
    def recorded_s(self) -> float:
        """Length of the recording so far, in its own time, s."""
        recorder = self._recorder
        return 0.0 if recorder is None else 1e-6 * recorder.duration_us

    def set_active(self, watched: bool) -> None:
        """Set whether a browser watches the rally. While nobody does, the source pauses, unless the rally is recorded,
        learns, is streamed, or an external robot plays.
        """
        self._watched = watched
        self._listen()

    @contextmanager
    def kept_awake(self) -> Iterator[None]:
        """The source runs inside of this, also if no browser watches."""
        self._keep(1)
        try:
            yield
        finally:
            self._keep(-1)

    @property
    def is_awake(self) -> bool:
        """Whether the source runs; otherwise it pauses, as nobody needs it."""
        return self._awake

    def _keep(self, more: int) -> None:
        with self._keeping:
            self._keepers += more
        self._listen()

    def _listen(self) -> None:
        robot_plays = self.robot is not None and self.robot.status.stop is None
        with self._keeping:
            kept = self._keepers or self._recorder is not None or self.learning.on or robot_plays
            awake = self._watched or bool(kept)
            if awake == self._awake:
                return
            self._awake = awake
            self.returns.drop_ball()  # nobody sees the whole of the ball in play
            if awake:
                self.watch.wake()
                self.player.wake()
            else:
                self.watch.rest()
            self._source_with_robot.listen(awake)

    def record(self, path: Path) -> None:
        """Write the rally to a file from now on.

        Raises:
            RecordingError: if one is being written already, or it cannot be made.
        """
        with self._recording_lock:
            if self._recorder is not None:
                raise RecordingError("the rally is being recorded already", where=self._recorder.path)
            self._recorder = LiveRecorder(self._source_with_robot, path, player=self.player)
            self._listen()

    def stop_recording(self) -> int:
        """Finish the file; returns its duration in microseconds, 0 if none was being written.

        Raises:
            RecordingError: if it could not be written to its end.
        """
        with self._recording_lock:
            if self._recorder is None:
                return 0
            try:
                return self._recorder.stop()
            finally:
                self._recorder = None
                self._listen()

    def recalibrate(self, cameras: Mapping[str, Camera]) -> bool:
        """Use these calibrations from now on; False if the source has its own."""
        if not isinstance(self.source, RecalibratedSource):
            return False
        self.source.recalibrate(cameras)
        return True

    @property
    def prediction(self) -> PredictionName:
        """How the hit is predicted."""
        return "filter" if self.player.config.chain.prediction == "filter" else "paper"

    def predict_with(self, name: PredictionName) -> None:
        """Predict with the filter, or with the paper's fit, from the next block on.

        Raises:
            RallyscopeError: if there is no such prediction, or the controller needs what it does not estimate.
        """
        config = self.player.config
        chain = with_prediction(config.chain, name)
        if getattr(self.player.controller, "needs_spin", False) and not chain.estimates_spin:
            remedy = "let another controller play first"
            raise CommandError("this policy needs the ball's spin, which the paper's fit does not give", remedy=remedy)
        self.player.configure(replace(config, chain=chain))

    def hit_at(self, rule: HitRule) -> None:
        """Meet the ball where it can be met, or at the paper's plane, from the next block on."""
        self.player.configure(replace(self.player.config, hit=rule))

    def begin_with(self, constants: FittedConstants) -> None:
        """Predict with fitted constants of air and table from the next block on; balls go on making them surer."""
        config = self.player.config
        self.player.configure(replace(config, chain=chain_with_constants(config.chain, constants)))

    def change_scene(self, scene: str) -> None:
        """Have the simulation show another scene, and wait for it.

        Raises:
            LinkError: if there is no simulation, or it refuses.
        """
        if self.simulation is None:
            raise LinkError("no scene to change", got=self.source.description, remedy="only a simulation has scenes")
        self.is_changing_scene = True
        try:
            self.simulation.set_scene(scene)
        finally:
            self.watch.wake()
            self.is_changing_scene = False

    def reset_counts(self) -> None:
        """Count returned balls from now on, and forget where balls landed."""
        self.returns.clear()
        self.history.clear_outcomes()

    def stop_simulation(self) -> None:
        """Stop the simulation process of this rally, if any; its history can still be watched."""
        if self._process is not None:
            self._process.stop()

    def close(self) -> None:
        """Close the rally; a recording in progress is finished."""
        self.stop_recording()
        self.player.close()
        self.learning.close()
        if self._outcome_classifier is not None:
            self._outcome_classifier.close()
        self._source_with_robot.close()
        if self.step_test is not None:
            self.step_test.close()
        self.recording.close()
        self.stop_simulation()

    # Callbacks of the source, in its thread.

    def on_session(self, welcome: m.Reply) -> None:
        """Reset for a new session."""
        self.history.clear()
        if self._outcome_classifier is not None:
            self._outcome_classifier.begin_anew()
        self.rows.clear()
        self.returns.drop_ball()
        self._session, self._forgotten_us = welcome.session, 0
        self.bodies, self._scene = PlayedBodies(), None
        self._drift = None

    def on_events(self, batch: m.EventBatch) -> None:
        """Ignore events; the ring recording keeps them."""

    def on_state(self, state: m.WorldState) -> None:
        """Store the true poses of racket and ball."""
        if not state.ends_block:
            return
        seed, truth = self.source.welcome.seed, state.truth()
        if state.scene and state.scene != self._scene and seed is not None:
            self._scene = state.scene
            self.bodies = self.bodies.then(state.start_us, state.scene, seed)
        if len(state.racket_t_us):
            self.history.add_rackets(state.racket_t_us, state.racket[:, :3], state.racket[:, 3:7])
            self.rows.add_state(state)
        if truth is not None:
            self.history.add_truth(truth)
        if state.t_us - self._forgotten_us > FORGET_EVERY_US:
            self._forgotten_us = state.t_us
            self.history.forget_before(state.t_us - round(REMEMBERED_S * 1e6))
            self.rows.forget_before(state.t_us - round(REMEMBERED_S * 1e6))

    def on_notice(self, notice: m.Notice) -> None:
        """Count the balls, and store landing points."""
        conditions = BallConditions(self.player.controller.name, self._scene or "")
        if isinstance(notice, m.ServeNotice):
            if was_followed(notice, self.player.snapshot):
                self.returns.begin_ball(conditions)
            else:  # nobody could play it: the detector is still being compiled, or far behind
                self.returns.drop_ball()
        elif isinstance(notice, m.OutcomeNotice):
            returned = notice.case == Case.RETURNED
            counted = self.returns.end_ball(conditions, returned=returned, speed_mps=notice.speed_mps)
            x, y, _ = notice.landing_m
            spot = LandingSpot(x, y, notice.case)
            self.rows.add_outcome(notice, self.player.controller.name)
            self.history.add_outcome(Outcome(notice.t_us, notice.serve_us, notice.speed_mps, spot, counted=counted))

    def _on_step(self, session: str, state: PlayerState, decision: RacketDecision | None) -> None:
        """Handle a step, in the player's thread."""
        if session == self._session:
            if not self.has_robot:  # there is no racket to show
                state, decision = replace(state, decision=None, choice=None), None
            self.history.add_step(state)
            self._watch_calibration(state)
            if self._outcome_classifier is not None:
                self._outcome_classifier.add_step(state.chain, state.decision)
            self.rows.add_step(state, decision)

    def _watch_calibration(self, state: PlayerState) -> None:
        """Update the drift, and weigh down the camera it names, in the player's thread; restarted in each session."""
        drift = self._drift
        if drift is None:
            drift = self._drift = CalibrationDrift(self.cameras)
        self.player.distrust(*drift.add(state.chain).distrusted)


def was_followed(serve: m.ServeNotice, snapshot: RallySnapshot) -> bool:
    """Whether the player had seen about all that there was of the session when a ball was served."""
    is_near = serve.t_us - snapshot.t_us <= BEHIND_US
    return snapshot.session == serve.session and snapshot.state is not None and is_near


def join_simulation(
    address: str,
    *,
    process: SimulationProcess | None = None,
    preparing: Callable[[float], None] = lambda share: None,
    keys: ClientKeys | None = None,
    robot: RobotClient | None = None,
) -> LiveRally:
    """The rally of the simulation at an address, when it is ready; `process` is ended with the rally.

    `preparing` hears how far a simulation is that is not ready, 0 to 1.

    Raises:
        LinkError: if there is no simulation, or one of another version, or it has a robot and there is a `robot` too.
    """
    try:
        client = SimulationClient(address, preparing=preparing, keys=keys)
    except LinkError:
        if process is not None:
            process.stop()
        raise
    try:
        return LiveRally(client, process=process, robot=robot, frame_detector=frame_detector())
    except LinkError:
        client.close()
        raise


def positions(cameras: dict[str, Camera]) -> dict[str, NDArray[np.float64]]:
    """Positions (3,) of the cameras, by name."""
    return {name: camera.T_world_camera[:3, 3] for name, camera in cameras.items()}
