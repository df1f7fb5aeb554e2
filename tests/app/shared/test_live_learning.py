"""A policy that learns in the live rally of the app, without a browser."""

import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.shared.live_learning import NO_OUTCOMES, NO_ROBOT, LiveLearning
from app.shared.live_rally import LiveRally, SimulationProcess, join_simulation
from app.shared.rallies import BUILT_IN, LEARNS, learning_start, let_play, run_choices, start_choices
from app.shared.workspace import Workspace
from core.errors import CommandError
from core.online_learning.progress import LearnedBall
from core.online_learning.start import NOTHING
from tests.waiting import eventually


@pytest.fixture(scope="module")
def live() -> Iterator[LiveRally]:
    process = SimulationProcess("--auto-serve", "5", "--seed", "3", "--sensor", "640x360")
    rally = join_simulation(process.wait(), process=process)
    assert rally.simulation is not None
    rally.simulation.set_speed(0.5)  # so that a busy machine is no part of the test
    yield rally
    rally.close()
    assert not any(thread.name == "online-learning" for thread in threading.enumerate())


def balls_of(learning: LiveLearning) -> tuple[LearnedBall, ...]:
    assert learning.progress is not None
    return learning.progress.balls


def test_balls_are_learned_from_while_it_plays_and_only_then(live: LiveRally, tmp_path: Path) -> None:
    workspace, learning = Workspace(tmp_path), live.learning
    assert learning.reason == "" and not learning.on and learning.progress is None
    live.player.aim_at((0.9, 0.1))
    let_play(live, workspace, LEARNS)
    live.set_active(False)  # the page is closed: it goes on
    assert learning.on and live.player.controller.name == LEARNS
    assert live.player.controller.goal_m.tolist() == [0.9, 0.1]
    eventually(lambda: sum(ball.learned for ball in balls_of(learning)) >= 2, "two balls to be learned from")
    decided = [ball for ball in live.player.snapshot.finished if ball.decision is not None]  # a ball may be too fast
    assert decided[-1].goal_m.tolist() == [0.9, 0.1]

    live.set_active(True)
    learning.stop()
    assert live.player.controller.name == BUILT_IN and live.player.controller.goal_m.tolist() == [0.9, 0.1]
    eventually(lambda: live.player.snapshot.phase == "idle", "the ball that flies to end")
    stood, played = len(balls_of(learning)), live.player.snapshot.played
    eventually(lambda: live.player.snapshot.played >= played + 2, "two more balls")
    assert len(balls_of(learning)) <= stood + 1  # the one that flew

    learning.save(workspace.run_path("learned-live-1"))
    assert run_choices(workspace) == ("learned-live-1",)
    assert start_choices(workspace) == (NOTHING, "learned-live-1")
    learning.save(workspace.run_path("scratch"))  # a name as good as any
    assert learning_start(workspace, "scratch").name == "scratch" and NOTHING not in run_choices(workspace)
    shutil.rmtree(workspace.run_path("scratch"))
    learning.begin()  # from where it was
    assert learning.on and len(balls_of(learning)) >= 2
    learning.reset(learning_start(workspace, "learned-live-1"))
    assert len(balls_of(learning)) < 2, "nothing of before: at most the ball that was played meanwhile"
    assert learning.progress is not None and learning.progress.start == "learned-live-1"
    with pytest.raises(CommandError, match="no run to start from"):
        learning_start(workspace, "../elsewhere")
    let_play(live, workspace, "learned-live-1")
    assert not learning.on and live.player.controller.name == "learned-live-1"


def test_a_source_without_robot_or_outcomes_says_why_nothing_is_learned(live: LiveRally) -> None:
    for robot, outcomes, reason in ((False, False, NO_ROBOT), (False, True, NO_ROBOT), (True, False, NO_OUTCOMES)):
        nothing = LiveLearning(live.player, robot=robot, outcomes=outcomes)
        assert nothing.reason == reason
        with pytest.raises(CommandError, match="cannot learn here"):
            nothing.begin()
        assert nothing.progress is None
        nothing.close()
