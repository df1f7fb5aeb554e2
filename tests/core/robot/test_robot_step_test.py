"""The step test while a rally is followed: not with a ball in the air, and the player leads by what it found."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from core.errors import NoAnswerError, TargetRefusedError
from core.events import Events
from core.live.live_player import LivePlayer
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from core.robot import SourceWithRobot, latency_test
from core.robot.robot_step_test import RobotStepTest

LATE_MS = 35.0


class CoveredStream:
    """A camera of a recording with a lens cap."""

    def __init__(self, stream, covered: threading.Event) -> None:
        self._stream, self._covered = stream, covered

    def __getattr__(self, name: str):
        return getattr(self._stream, name)

    def slice(self, start_us: int, end_us: int) -> Events:
        return Events.empty(self.sensor) if self._covered.is_set() else self._stream.slice(start_us, end_us)


class CoveredRecording:
    """A recording with such cameras."""

    def __init__(self, recording, covered: threading.Event) -> None:
        self._recording, self.duration_us = recording, recording.duration_us
        self.cameras = {name: CoveredStream(stream, covered) for name, stream in recording.cameras.items()}

    def close(self) -> None:
        self._recording.close()


def test_no_ball_may_fly_and_what_is_found_is_led_by(late_robot, wait_for, serve_recording, monkeypatch) -> None:
    monkeypatch.setattr(latency_test, "TRIES", 20)  # a busy machine sees fewer of them whole
    covered = threading.Event()
    recording: Any = CoveredRecording(open_recording(serve_recording), covered)
    decided: list[tuple[float, float]] = []

    def hear(session, state, decision) -> None:
        if decision is not None:
            decided.append((state.chain.prediction.hit_plane.t_s, decision.target.t_s))

    with late_robot(1e-3 * LATE_MS) as robot:
        source = SourceWithRobot(ReplaySource(recording, "serve.h5"), robot)
        player = LivePlayer(source)
        test = RobotStepTest(player, robot)
        try:
            player.add_listener(hear)
            wait_for(lambda: len(decided) > 5, "balls that are played")
            with pytest.raises(TargetRefusedError, match="a ball flies"):
                test.run()
            assert test.report.problem == "a ball flies" and not test.report.running and player.latency is None
            assert all(target_s == hit_s for hit_s, target_s in decided)

            covered.set()
            wait_for(lambda: player.snapshot.t_us - player.snapshot.points[-1].t_us > 1_100_000, "an empty table")
            with ThreadPoolExecutor(1) as pool:
                running = pool.submit(test.run)
                wait_for(lambda: test.report.done > 0 or running.done(), "the first step")
                if not running.done():
                    with pytest.raises(TargetRefusedError, match="one is running"):
                        test.run()
                for _ in range(4):  # an answer that is late on a busy machine ends it
                    if isinstance(running.exception(), NoAnswerError | TargetRefusedError):
                        running = pool.submit(test.run)
                running.result()
            found = test.report.found
            assert found is not None and player.latency is found, test.report
            assert 1e3 * found.mean_s == pytest.approx(LATE_MS, abs=2.0)

            decided.clear()
            covered.clear()
            wait_for(lambda: len(decided) > 5, "balls that are played again")
            assert all(hit_s - target_s == pytest.approx(found.mean_s, abs=1e-9) for hit_s, target_s in decided)

            covered.set()
            wait_for(lambda: player.snapshot.t_us - player.snapshot.points[-1].t_us > 1_100_000, "an empty table")
            test.begin()
            wait_for(lambda: test.report.done > 0, "the first step")
            covered.clear()
            wait_for(lambda: not test.report.running, "a ball to end it")
            assert test.report.problem == "a ball flies" and test.report.found is found
        finally:
            player.close()
            source.close()
            test.close()
