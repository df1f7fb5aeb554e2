"""The chain over a recording, in the background: its history grows while it is watched."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera
from core.chain.calibration_drift import CalibrationDrift
from core.chain.chain import RallyChain
from core.chain.config import WINDOW_US, ChainConfig, PredictionName, with_prediction
from core.chain.control.controller import BuiltInController
from core.chain.control.player import Player
from core.chain.follow import calibrated_cameras, calibrated_rig, frame_cameras, windows_with_frames
from core.detection import Detector
from core.history.played_bodies import PlayedBodies, recorded_bodies
from core.history.rally_history import Outcome, RallyHistory
from core.history.rally_picture import LandingSpot
from core.history.recorded_rally import EPISODES, RACKET, HasRows, read_choices, read_targets
from core.history.seen_outcomes import note_stroke
from core.outcomes import OutcomeClassifier
from core.physics.episode import Case
from core.recordings import BallTruth, Recording
from core.recordings.frames import FrameStream
from core.recordings.reader import FileRecording

logger = logging.getLogger(__name__)


AT_SPOT_M: Final = 0.05
"""A true ball this near to its landing spot has landed there. Chosen by hand; not measured."""
NEVER_US: Final = 2**62
KNOWN_CASES: Final = frozenset(int(case) for case in Case)
"""Outcomes that are known; a row with another value is skipped."""


def add_known(history: RallyHistory, ball: BallTruth | None, rows: HasRows) -> None:
    """Add the recorded truth, racket, targets and outcomes."""
    if ball is not None:
        history.add_truth(ball)
    racket, episodes = rows.read_rows(RACKET), rows.read_rows(EPISODES)
    if racket is not None:
        history.add_rackets(*(np.asarray(racket[name]) for name in ("t_us", "p_world_m", "q_world_wxyz")))
    history.add_targets(read_targets(rows))
    history.add_choices(read_choices(rows))
    if episodes is not None:
        columns = (np.asarray(episodes[name]) for name in ("serve_us", "speed_mps", "case", "f"))
        rows_of = list(zip(*columns, strict=True))
        ends_us = [*(int(row[0]) for row in rows_of[1:]), NEVER_US]
        for (serve_us, speed_mps, case, landing), until_us in zip(rows_of, ends_us, strict=True):
            if case not in KNOWN_CASES:
                continue
            spot = LandingSpot(float(landing[0]), float(landing[1]), Case(int(case)))
            known_us = _known_us(ball, int(serve_us), until_us, np.asarray(landing, np.float64))
            history.add_outcome(Outcome(known_us, int(serve_us), float(speed_mps), spot))


def _known_us(ball: BallTruth | None, serve_us: int, until_us: int, landing: NDArray[np.float64]) -> int:
    """When it was seen what came of a ball, which rows of episodes do not say.

    It is when the true ball is at its landing spot; where it never is, when it is gone; without a true ball, its serve.
    """
    if ball is None:
        return serve_us
    rows = (ball.t_us >= serve_us) & (ball.t_us < until_us) & np.isfinite(ball.p_world_m).all(axis=1)
    if not rows.any():
        return serve_us
    with np.errstate(over="ignore"):  # a damaged one may be absurdly far away
        t_us, away_m = ball.t_us[rows], np.linalg.norm(ball.p_world_m[rows] - landing, axis=1)
    nearest = int(np.argmin(np.nan_to_num(away_m, nan=np.inf)))
    return int(t_us[nearest] if away_m[nearest] < AT_SPOT_M else t_us[-1])


def is_stereo(recording: Recording) -> bool:
    """Whether the ball can be found in space: two cameras or more, all calibrated."""
    streams = recording.cameras.values()
    return len(streams) > 1 and all(stream.calibration is not None for stream in streams)


class Following:
    """One pass over one stereo recording. What the file itself knows of racket and outcomes is there at once; where it
    knows no outcomes, strokes are judged by what is seen.
    """

    def __init__(
        self,
        recording: Recording,
        config: ChainConfig | None = None,
        frame_detector: Callable[[], Detector] | None = None,
    ) -> None:
        """Begin; `config` is that of the chain, by default the usual one.

        `frame_detector` makes the detector of each calibrated frame camera; without one those are left out.
        """
        self._config, self._frame_detector = config or ChainConfig(), frame_detector
        self.history = RallyHistory()
        self.cameras: dict[str, Camera] = (calibrated_cameras if frame_detector is None else calibrated_rig)(recording)
        self.frames: dict[str, FrameStream] = {} if frame_detector is None else frame_cameras(recording)
        """Pictures of the frame cameras that are followed."""
        self.drift = CalibrationDrift(self.cameras)
        """Whether the cameras fit each other."""
        self.bodies = PlayedBodies()
        """Who is in it, as far as that is known."""
        self.share = 0.0
        """Share of the recording that has been processed, 0..1."""
        self._recording = recording
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="following", daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Until all of it has been followed."""
        self._thread.join()

    def stop(self) -> None:
        """Give up."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            self.bodies = recorded_bodies(self._recording)
            if isinstance(self._recording, FileRecording):
                add_known(self.history, self._recording.ball, self._recording)
            elif self._recording.ball is not None:
                self.history.add_truth(self._recording.ball)
            self._follow()
        except Exception:
            logger.exception("the chain failed on a recording")

    def _follow(self) -> None:
        make = self._frame_detector
        detectors = {} if make is None else {name: make() for name in self.frames}
        player = Player(RallyChain(self.cameras, self._config, detectors), BuiltInController())
        judge = None if self.history.outcome_count else OutcomeClassifier()
        duration_us = self._recording.duration_us
        for windows in windows_with_frames(self._recording.cameras, self.frames, duration_us, WINDOW_US):
            if self._stop.is_set():
                return
            state = player.step(windows)
            self.history.add_step(state)
            player.chain.distrust(*self.drift.add(state.chain).distrusted)
            if judge is not None:
                note_stroke(self.history, judge.step(state.chain, self.history.recorded_target(state.chain.t_us)))
            self.share = state.chain.t_us / duration_us
        self.share = 1.0


class Followings:
    """One Following a recording and prediction, shared by all browsers."""

    def __init__(self) -> None:
        self.chain = ChainConfig()
        """Chain that those begun from now on use; their prediction is chosen for each."""
        self.frame_detector: Callable[[], Detector] | None = None
        """Makes the detector of a frame camera; None: frame cameras are left out."""
        self._lock = threading.Lock()
        self._found: dict[tuple[str, PredictionName], Following] = {}

    def of(self, recording: Recording, prediction: PredictionName = "filter") -> Following | None:
        """The one of a recording with a prediction, begun now if need be; None if it is not stereo."""
        if not is_stereo(recording):
            return None
        with self._lock:
            key = (recording.uuid, prediction)
            found = self._found.get(key)
            if found is None:
                found = self._found[key] = Following(
                    recording, with_prediction(self.chain, prediction), self.frame_detector
                )
            return found

    def close(self) -> None:
        """Give up all."""
        with self._lock:
            for following in self._found.values():
                following.stop()
            self._found.clear()
