"""The step test while a rally is followed: not with a ball in the air, and the player leads by what it found."""

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from core.errors import NoAnswerError, TargetRefusedError
from core.events import Events
from core.live.live_player import LivePlayer, LivePlayerConfig
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from core.robot import SourceWithRobot, latency_test
from core.robot.robot_step_test import RobotStepTest
from tests.waiting import PATIENCE_S, eventually

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


def test_no_ball_may_fly_and_what_is_found_is_led_by(late_robot, serve_recording, monkeypatch) -> None:
    monkeypatch.setattr(latency_test, "TRIES", 20)  # a busy machine sees fewer of them whole
    covered = threading.Event()
    recording: Any = CoveredRecording(open_recording(serve_recording), covered)
    decided: list[tuple[float, float]] = []

    def hear(session, state, decision) -> None:
        if decision is not None:
            decided.append((state.chain.prediction.hit_plane.t_s, decision.target.t_s))

    with late_robot(1e-3 * LATE_MS) as robot:
        source = SourceWithRobot(ReplaySource(recording, "serve.h5"), robot)
        player = LivePlayer(source, config=LivePlayerConfig(hit="paper"))
        test = RobotStepTest(player, robot)
        try:
            player.add_listener(hear)
            eventually(lambda: len(decided) > 5, "balls that are played")
            with pytest.raises(TargetRefusedError, match="a ball flies"):
                test.run()
            assert test.report.problem == "a ball flies" and not test.report.running and player.latency is None
            assert all(target_s == hit_s for hit_s, target_s in decided)

            covered.set()
            eventually(lambda: player.snapshot.t_us - player.snapshot.points[-1].t_us > 1_100_000, "an empty table")
            with ThreadPoolExecutor(1) as pool:
                running = pool.submit(test.run)
                eventually(lambda: test.report.done > 0 or running.done(), "the first step")
                if not running.done():
                    with pytest.raises(TargetRefusedError, match="one is running"):
                        test.run()
                running.exception(PATIENCE_S)  # waits for its end

            def found_before_or_again() -> bool:
                try:
                    return test.report.found is not None or bool(test.run())
                except (NoAnswerError, TargetRefusedError):  # an answer that is late on a busy machine ends it
                    return False

            eventually(found_before_or_again, "a test that is not broken off", lambda: test.report)
            found = test.report.found
            assert found is not None and player.latency is found, test.report
            clock = robot.status.clock
            assert (
                clock is not None
            )  # the figure is as good as the clocks, and as the steps are alike, on a busy machine
            assert 1e3 * found.mean_s == pytest.approx(LATE_MS, abs=2.0 + 4e3 * found.sigma_s + 1e-3 * clock.within_us)

            decided.clear()
            covered.clear()
            eventually(lambda: len(decided) > 5, "balls that are played again")
            assert all(hit_s - target_s == pytest.approx(found.mean_s, abs=1e-9) for hit_s, target_s in decided)

            def ended_by_a_ball() -> bool:
                covered.set()
                eventually(lambda: player.snapshot.t_us - player.snapshot.points[-1].t_us > 1_100_000, "an empty table")
                test.begin()
                eventually(lambda: test.report.done > 0 or test.report.problem, "the first step")
                covered.clear()
                test.close()  # waits for its end
                return test.report.done > 0 and test.report.problem == "a ball flies"

            eventually(ended_by_a_ball, "a ball to end it", lambda: test.report)
            assert test.report.found is found
        finally:
            player.close()
            source.close()
            test.close()
