"""A live player over the link plays balls from a seed, survives the server's end, and never holds anybody up."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.chain import ChainConfig
from core.chain.control.controller import BuiltInController
from core.errors import ConfigError
from core.events import SensorSize
from core.live.link.client import SimulationClient
from core.live.link.server import ServerConfig, SimulationServer
from core.live.live_player import LivePlayer, LivePlayerConfig
from core.live.live_snapshot import EVERY_S, SPAN_S, RallySnapshot
from core.live.worlds.world import WorldConfig
from core.physics.config import PhysicsConfig, Profile, physics_profile
from core.physics.episode import Case
from core.physics.task import task_profile

SLOW = 0.4
"""So that a busy machine is no part of the test."""


@contextmanager
def serving(
    address: str = "tcp://127.0.0.1:0", seed: int = 5, physics: Profile = "paper", **size: int
) -> Iterator[str]:
    sensor = SensorSize(size.get("width", 1280), size.get("height", 720))
    world = WorldConfig(task=task_profile(physics))
    server = SimulationServer(ServerConfig(world=world), stereo_preset("side", sensor), address, seed=seed)
    ended = threading.Event()
    thread = threading.Thread(target=server.run, args=(ended.is_set,))
    thread.start()
    try:
        yield server.address
    finally:
        ended.set()
        thread.join()


def wait_for(true: Callable[[], object], seconds: float = 300) -> None:
    until = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def rally() -> Iterator[tuple[SimulationClient, LivePlayer, list[RallySnapshot]]]:
    """A client and a player that has played one ball at 5 m/s; the snapshots that were seen meanwhile."""
    with serving() as address:
        client = SimulationClient(address)
        player = LivePlayer(client)
        wait_for(lambda: player.snapshot.t_us > 0)
        client.launch((1.0, 0.0, 0.3), (-4.0, 0.0, 1.0))
        wait_for(lambda: player.snapshot.played == 1)
        wait_for(lambda: player.snapshot.phase == "idle")
        client.set_speed(SLOW)
        client.serve(5.0)
        seen = [player.snapshot]

        def judged() -> bool:
            if player.snapshot is not seen[-1]:
                seen.append(player.snapshot)
            return player.snapshot.played == 2

        wait_for(judged)
        yield client, player, seen
        player.close()
        client.close()


def test_a_ball_from_a_seed_is_returned_near_its_goal(rally) -> None:
    _, player, _ = rally
    ball = player.snapshot.finished[1]
    assert ball.returned and ball.case is Case.RETURNED
    assert ball.speed_mps == pytest.approx(5.0)
    assert ball.error_m < 0.25 and ball.error_m == pytest.approx(np.hypot(*(ball.landing_m - ball.goal_m)))
    assert ball.decision is not None and ball.decision.stage == "post"
    assert ball.serve_us < ball.decision.t_us < ball.t_us
    assert abs(ball.decision.state[0] + 1.42) < 1e-9 and ball.decision.state[3] < 0
    assert player.snapshot.returned >= 1


def test_snapshots_tell_the_story_of_a_flight(rally) -> None:
    _, player, seen = rally
    serve_us = player.snapshot.finished[1].serve_us
    of_ball = [one.newest for one in seen if one.newest is not None and serve_us < one.newest.t_us]
    pre = next(found for found in of_ball if found.stage == "pre")
    post = next(found for found in of_ball if found.stage == "post")
    assert of_ball[0] is pre and pre.t_us < post.t_us
    assert all(one.number > before.number for before, one in itertools.pairwise(seen))
    assert all(one.t_us >= before.t_us for before, one in itertools.pairwise(seen))


def test_what_is_seen_is_where_the_truth_is(rally) -> None:
    errors = []
    for one in rally[2]:
        if one.ball is not None and one.points and abs(one.points[-1].t_us - one.ball.t_us) <= 1000:
            lag_s = (one.points[-1].t_us - one.ball.t_us) * 1e-6
            errors.append(np.linalg.norm(one.points[-1].p_world_m - one.ball.p_world_m - lag_s * one.ball.v_world_mps))
    assert len(errors) > 20
    assert np.median(errors) < 0.01


def test_the_racket_moves_to_where_the_ball_is_expected(rally) -> None:
    _, player, seen = rally
    decision = player.snapshot.finished[1].decision
    nearest = min(np.linalg.norm(one.racket.p_world_m - decision.target.p_m) for one in seen)
    assert nearest < 0.06
    assert np.linalg.norm(seen[0].racket.p_world_m - decision.target.p_m) > 0.1


def test_its_health_is_told(rally) -> None:
    player = rally[1]
    began_s, began = time.monotonic(), player.snapshot
    time.sleep(SPAN_S + EVERY_S)
    health, ended = player.snapshot.health, player.snapshot
    windows = (ended.t_us - began.t_us) / LivePlayerConfig().window_us
    assert health.state_hz == pytest.approx(windows / (time.monotonic() - began_s), rel=0.3), "each window is a step"
    assert health.commands_sent > 10 and health.blocks > 100
    assert 0 < health.arrival_to_sent.p50_ms <= health.arrival_to_sent.p99_ms
    assert health.window_to_sent.p50_ms > health.arrival_to_sent.p50_ms
    assert 0 < health.core_share < 1


def test_controllers_goals_and_settings_are_swapped_while_it_runs(rally) -> None:
    _, player, _ = rally
    player.aim_at((1.0, 0.3))
    wait_for(lambda: player.snapshot.goal_m.tolist() == [1.0, 0.3])
    with pytest.raises(ConfigError):
        player.aim_at((-1.0, 0.0))
    player.use(BuiltInController())
    wait_for(lambda: player.snapshot.goal_m.tolist() == [0.8, 0.0])
    player.configure(LivePlayerConfig(chain=ChainConfig(method="paper"), window_us=1000))
    blocks = player.snapshot.health.blocks
    wait_for(lambda: player.snapshot.health.blocks > blocks + 5)
    assert player.snapshot.problem == ""
    player.configure(LivePlayerConfig())
    with pytest.raises(ConfigError, match="divisor"):
        LivePlayerConfig(window_us=3000)


def test_a_player_that_only_watches_sends_nothing(rally) -> None:
    client, player, _ = rally
    wait_for(lambda: player.snapshot.phase == "idle")
    sent = player.snapshot.health.commands_sent
    player.play(False)
    played = player.snapshot.played
    client.serve(6.0)
    wait_for(lambda: player.snapshot.played > played)
    player.play(True)
    ball = player.snapshot.finished[-1]
    assert ball.decision is None
    assert np.linalg.norm(player.snapshot.racket.v_world_mps) < 0.01
    newest = player.snapshot.newest
    assert newest is not None and newest.t_us > ball.serve_us, "it still sees and predicts"
    assert player.snapshot.health.commands_sent == sent


def told_physics(player: LivePlayer) -> PhysicsConfig:
    assert isinstance(player.controller, BuiltInController)
    return player.controller.task.physics


def test_nobody_says_how_balls_fly_unless_asked(rally) -> None:
    client, player, _ = rally
    wait_for(lambda: player.snapshot.t_us > 0)
    assert client.physics == physics_profile("paper"), "the source knows"
    assert not player.config.knows_physics and player._chain_config() == player.config.chain
    assert player.config.chain.filter.perhaps_real
    told, known = told_physics(player), physics_profile("paper")
    assert told.air != known.air and told.table != known.table
    assert told.rubber == known.rubber, "the racket is one's own"


def test_a_server_that_is_killed_and_started_again_is_played_on() -> None:
    with serving(seed=1, width=320, height=240) as address:
        client = SimulationClient(address, timeout_s=3.0)
        player = LivePlayer(client, config=LivePlayerConfig(knows_physics=True))
        wait_for(lambda: player.snapshot.t_us > 100_000)
        first = player.snapshot.session
        assert client.physics == told_physics(player) == physics_profile("paper")
    with serving(address, seed=2, physics="real", width=320, height=240):
        wait_for(lambda: player.snapshot.session not in ("", first) and player.snapshot.t_us > 100_000)
        client.launch((1.0, 0.0, 0.3), (-4.0, 0.0, 1.0))
        wait_for(lambda: player.snapshot.played == 1)
        assert player.snapshot.problem == "" and len(player.snapshot.finished) == 1
        assert client.physics == told_physics(player) == physics_profile("real")
        player.use(BuiltInController())
        assert told_physics(player) == physics_profile("real"), "whoever plays is told"
    player.close()
    client.close()


def test_what_it_cannot_follow_is_dropped_and_nobody_waits_for_it(rally) -> None:
    """A listener holds the player up for 30 blocks at every prediction; link and simulation go on."""
    client, player, _ = rally
    wait_for(lambda: player.snapshot.phase == "idle")
    dropped, went_on = player.snapshot.health.blocks_dropped, []

    def hold(*_: object) -> None:
        t_us = client.state.t_us
        wait_for(lambda: client.state.t_us - t_us > 300_000)
        went_on.append(True)

    player.add_listener(hold)
    client.serve(5.0)
    wait_for(lambda: went_on)
    player.remove_listener(hold)
    wait_for(lambda: player.snapshot.health.blocks_dropped > dropped + 10)
    wait_for(lambda: client.state.t_us - player.snapshot.t_us <= 30_000)
