"""The chain over a recording, in the background: its history grows while it is watched."""

from __future__ import annotations

import logging
import threading

from core.cameras import Camera
from core.chain.calibration_drift import CalibrationDrift
from core.chain.chain import RallyChain
from core.chain.config import ChainConfig
from core.chain.control.controller import BuiltInController
from core.chain.control.player import Player
from core.chain.follow import calibrated_cameras
from core.detection.window import windows_side_by_side
from core.history.played_bodies import PlayedBodies, recorded_bodies
from core.history.rally_history import RallyHistory
from core.history.recorded_history import add_known
from core.history.seen_outcomes import note_stroke
from core.outcomes import OutcomeClassifier
from core.recordings import Recording
from core.recordings.reader import FileRecording

logger = logging.getLogger(__name__)
WINDOW_US = 2_000


def is_stereo(recording: Recording) -> bool:
    """Whether the ball can be found in space: two cameras or more, all calibrated."""
    streams = recording.cameras.values()
    return len(streams) > 1 and all(stream.calibration is not None for stream in streams)


class Following:
    """One pass over one stereo recording. What the file itself knows of racket and outcomes is there at once; where it
    knows no outcomes, strokes are judged by what is seen.
    """

    def __init__(self, recording: Recording) -> None:
        self.history = RallyHistory()
        self.cameras: dict[str, Camera] = calibrated_cameras(recording)
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
        player = Player(RallyChain(self.cameras, ChainConfig()), BuiltInController())
        judge = None if self.history.outcome_count else OutcomeClassifier()
        duration_us = self._recording.duration_us
        for windows in windows_side_by_side(self._recording.cameras, 0, duration_us, WINDOW_US):
            if self._stop.is_set():
                return
            state = player.step(windows)
            self.history.add_step(state)
            self.drift.add(state.chain)
            if judge is not None:
                note_stroke(self.history, judge.step(state.chain))
            self.share = state.chain.t_us / duration_us
        self.share = 1.0


class Followings:
    """One Following a recording, shared by all browsers."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[str, Following] = {}

    def of(self, recording: Recording) -> Following | None:
        """The one of a recording, begun now if need be; None if it is not stereo."""
        if not is_stereo(recording):
            return None
        with self._lock:
            found = self._found.get(recording.uuid)
            if found is None:
                found = self._found[recording.uuid] = Following(recording)
            return found

    def close(self) -> None:
        """Give up all."""
        with self._lock:
            for following in self._found.values():
                following.stop()
            self._found.clear()
