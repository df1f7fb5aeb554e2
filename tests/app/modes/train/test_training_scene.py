"""Which ball plays when, and by whom."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from app.modes.train.training_scene import BallOrder, RallyPlayer, RallyRequest, make_replay
from app.shared.rallies import run_choices
from app.shared.workspace import Workspace
from core.learning.runs.run_files import read_lines, read_run, seed_files
from tests.waiting import eventually


@pytest.fixture(scope="module")
def lines(trained: Workspace) -> tuple[dict, ...]:
    return tuple(read_lines(seed_files(trained.run_path("small"), 0).metrics)[0])


def test_the_newest_ball_comes_first_and_old_ones_only_while_there_is_no_newer_one(lines) -> None:
    order = BallOrder()
    assert order.next_line(()) is None
    assert order.next_line(lines[:3]) is lines[2]
    assert [order.next_line(lines[:3]) for _ in range(4)] == [lines[0], lines[1], lines[2], lines[0]]
    assert order.next_line(lines[:9]) is lines[8]


@pytest.mark.parametrize("player", ["training ball", "current policy", "best so far"])
def test_a_ball_can_be_played_by_each(trained: Workspace, lines, player) -> None:
    run = trained.run_path("small")
    replay = make_replay(RallyRequest(run, read_run(run), 0, lines[0], player))
    assert replay is not None and replay.ball.episode == 0
    assert ("random" in replay.title) == (player == "training ball")
    if player != "training ball":
        assert player in replay.title and replay.error_mm < 200 < lines[0]["error_mm"]


def test_before_the_first_checkpoint_the_training_ball_stands_in(trained: Workspace, lines, tmp_path) -> None:
    config = read_run(trained.run_path("small"))
    replay = make_replay(RallyRequest(tmp_path, config, 0, lines[0], "best so far"))
    assert replay is not None and "no policy" in replay.title
    assert make_replay(RallyRequest(tmp_path, config, 0, {}, "training ball")) is None


def test_balls_follow_each_other(trained: Workspace, lines) -> None:
    run = trained.run_path("small")
    config = read_run(run)
    with ThreadPoolExecutor(1) as pool:
        todo = []
        player = RallyPlayer(pool, todo.append, lambda error: pytest.fail(str(error)))
        player.set_speed(2.0)
        seen, began = [], {}
        for tick in range(400):
            wall_s = tick / 50
            player.advance(wall_s, run, config, 0, lines[:3] if tick < 200 else lines)
            if not todo and player._asked is not None:
                eventually(lambda: todo, "the ball that was asked for")
            while todo:
                todo.pop(0)()
            if player.replay is not None and (not seen or seen[-1] is not player.replay):
                seen.append(player.replay)
                began[len(seen)] = wall_s
        player.close()
    episodes = [replay.ball.episode for replay in seen]
    assert episodes[:2] == [2, 0] and 39 in episodes and len(seen) >= 5
    assert began[2] - began[1] >= seen[0].duration_s / 2


def test_runs_with_a_policy_are_offered_the_newest_first(trained: Workspace, tmp_path) -> None:
    assert run_choices(trained) == ("small",)
    empty = Workspace(tmp_path)
    assert run_choices(empty) == ()
