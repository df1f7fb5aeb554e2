"""A live player over the link plays balls from a seed, survives the server's end, and never holds anybody up."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.chain import ChainConfig
from core.chain.control.controller import BuiltInController, RacketDecision
from core.chain.control.player import PlayerState
from core.errors import ConfigError
from core.events import SensorSize
from core.live.link.client import SimulationClient
from core.live.link.server import ServerConfig, SimulationServer
from core.live.live_player import LivePlayer, LivePlayerConfig
from core.live.live_snapshot import LiveMeter, RallySnapshot
from core.live.worlds.world import WorldConfig
from core.physics.config import PhysicsConfig, Profile, physics_profile
from core.physics.episode import Case
from core.physics.task import task_profile
from core.simulation.event_cameras.event_camera import BLOCK_US
from tests.core.live.stepped import play_block
from tests.ports import lasting_address
from tests.simulation_servers import serving
from tests.waiting import PATIENCE_S, eventually

SLOW = 0.4
"""So that a busy machine is no part of the test."""


@contextmanager
def serving_balls(
    address: str = "tcp://127.0.0.1:0", seed: int = 5, physics: Profile = "paper", **size: int
) -> Iterator[str]:
    sensor = SensorSize(size.get("width", 1280), size.get("height", 720))
    world = WorldConfig(task=task_profile(physics))
    server = SimulationServer(ServerConfig(world=world), stereo_preset("side", sensor), address, seed=seed)
    with serving(server):
        yield server.address


@pytest.fixture(scope="module")
def rally() -> Iterator[tuple[SimulationClient, LivePlayer, list[RallySnapshot]]]:
    """A client and a player that has played balls, the last one at 5 m/s and in steps; what was seen of that one."""
    with serving_balls() as address:
        client = SimulationClient(address, timeout_s=PATIENCE_S)
        player = LivePlayer(client)
        eventually(lambda: player.snapshot.t_us > 0, "the first block to be played")
        client.set_speed(SLOW)
        while not player.snapshot.health.commands_sent:  # a busy machine may see too little of a ball
            played = player.snapshot.played
            client.launch((1.0, 0.0, 0.3), (-4.0, 0.0, 1.0))
            eventually(lambda: player.snapshot.played > played, "the ball to be judged")  # noqa: B023
            eventually(lambda: player.snapshot.phase == "idle", "its flight to be over")
        client.pause()
        play_block(client, player)
        client.serve(5.0)
        played, seen = player.snapshot.played, [player.snapshot]
        while player.snapshot.played == played:
            play_block(client, player)
            seen.append(player.snapshot)
        client.resume()
        yield client, player, seen
        player.close()
        client.close()


def test_a_ball_from_a_seed_is_returned_near_its_goal(rally) -> None:
    _, player, seen = rally
    ball = seen[-1].finished[-1]
    assert ball.returned and ball.case is Case.RETURNED
    assert ball.speed_mps == pytest.approx(5.0)
    assert ball.error_m < 0.25 and ball.error_m == pytest.approx(np.hypot(*(ball.landing_m - ball.goal_m)))
    assert ball.decision is not None and ball.decision.stage == "post"
    assert ball.serve_us < ball.decision.t_us < ball.t_us
    assert -1.82 <= ball.decision.state[0] <= -1.0 and ball.decision.state[3] < 0, "where it is chosen by default"
    assert player.snapshot.returned >= 1


def test_snapshots_tell_the_story_of_a_flight(rally) -> None:
    _, _, seen = rally
    serve_us = seen[-1].finished[-1].serve_us
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
    _, _, seen = rally
    decision = seen[-1].finished[-1].decision
    nearest = min(np.linalg.norm(one.racket.p_world_m - decision.target.p_m) for one in seen)
    assert nearest < 0.06
    assert np.linalg.norm(seen[0].racket.p_world_m - decision.target.p_m) > 0.1


def test_its_health_is_told(rally) -> None:
    client, player, seen = rally
    eventually(lambda: player.snapshot.health.commands_sent > 10, "the newest figures", lambda: player.snapshot.health)
    health = player.snapshot.health
    assert health.blocks > 100 and health.state_hz > 0 and health.core_share > 0
    assert 0 < health.arrival_to_sent.p50_ms <= health.arrival_to_sent.p99_ms
    first = seen[0].health  # the first ball's only: in steps, nobody knows when a window ended
    assert first.window_to_sent.p50_ms > first.arrival_to_sent.p50_ms > 0
    steps: list[int] = []

    def note(session: str, state: PlayerState, decision: object) -> None:
        steps.append(state.chain.t_us)

    client.pause()
    play_block(client, player)
    player.add_step_listener(note)
    for _ in range(5):
        play_block(client, player)
    client.resume()
    per_block = BLOCK_US // LivePlayerConfig().window_us
    assert set(np.diff(steps[: 5 * per_block])) == {LivePlayerConfig().window_us}, "each window is a step"


def test_its_rate_and_its_share_of_a_core_are_those_of_the_last_seconds(monkeypatch) -> None:
    now_s, spent_s = 100.0, 7.0
    clocks = SimpleNamespace(monotonic=lambda: now_s, thread_time=lambda: spent_s)
    monkeypatch.setattr("core.live.live_snapshot.time", clocks)
    meter = LiveMeter()
    for rate_hz, share in ((100, 0.1), (500, 0.25)):
        for _ in range(40):
            for _ in range(rate_hz // 10):
                meter.note_step(0.002)
            now_s, spent_s = now_s + 0.1, spent_s + 0.1 * share
            health = meter.health()
    assert health.state_hz == pytest.approx(500, rel=0.02) and health.core_share == pytest.approx(0.25, rel=0.02)
    assert health.step.p50_ms == pytest.approx(2.0)


def test_controllers_goals_and_settings_are_swapped_while_it_runs(rally) -> None:
    _, player, _ = rally
    player.aim_at((1.0, 0.3))
    eventually(lambda: player.snapshot.goal_m.tolist() == [1.0, 0.3], "the new goal")
    with pytest.raises(ConfigError):
        player.aim_at((-1.0, 0.0))
    player.use(BuiltInController())
    eventually(lambda: player.snapshot.goal_m.tolist() == [0.8, 0.0], "the goal of the new controller")
    player.configure(LivePlayerConfig(chain=ChainConfig(method="paper"), window_us=1000))
    blocks = player.snapshot.health.blocks
    eventually(lambda: player.snapshot.health.blocks > blocks + 5, "blocks with the new settings")
    assert player.snapshot.problem == ""
    player.configure(LivePlayerConfig())
    with pytest.raises(ConfigError, match="divisor"):
        LivePlayerConfig(window_us=3000)


def test_a_block_leads_to_one_command_which_is_its_newest_decision(rally, monkeypatch) -> None:
    client, player, _ = rally
    aim_racket, sent, decided = client.aim_racket, [], []

    def note_command(p_m, q_wxyz, v_mps, t_us, cameras=()):
        sent.append((p_m, t_us))
        return aim_racket(p_m, q_wxyz, v_mps, t_us, cameras)

    def note_decision(session: str, state: PlayerState, decision: RacketDecision | None) -> None:
        if decision is not None:
            decided.append(decision)

    eventually(lambda: player.snapshot.phase == "idle" and player.idle, "no ball to fly")
    client.pause()
    monkeypatch.setattr(client, "aim_racket", note_command)
    player.add_listener(note_decision)
    client.serve(5.0)
    played = player.snapshot.played
    while player.snapshot.played == played:
        play_block(client, player)
    player.remove_listener(note_decision)
    client.resume()
    newest = {(one.t_us - 1) // BLOCK_US: one.target for one in decided}
    assert len(decided) > 2 * len(newest), "most blocks have several decisions"
    assert sent == [(tuple(one.p_m.tolist()), round(1e6 * one.t_s)) for one in newest.values()]


def test_a_player_that_only_watches_sends_nothing(rally) -> None:
    client, player, _ = rally
    eventually(lambda: player.snapshot.phase == "idle", "no ball to fly")
    sent = player.snapshot.health.commands_sent
    player.play(False)
    played = player.snapshot.played
    client.pause()
    client.serve(6.0)
    while player.snapshot.played == played:
        play_block(client, player)
    client.resume()
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
    eventually(lambda: player.snapshot.t_us > 0, "the first block to be played")
    assert client.physics == physics_profile("paper"), "the source knows"
    assert not player.config.knows_physics and player._chain_config() == player.config.chain
    assert player.config.chain.filter.perhaps_real
    told, known = told_physics(player), physics_profile("paper")
    assert told.air != known.air and told.table != known.table
    assert told.rubber == known.rubber, "the racket is one's own"


def test_a_server_that_is_killed_and_started_again_is_played_on() -> None:
    with serving_balls(lasting_address(), seed=1, width=320, height=240) as address:
        client = SimulationClient(address, timeout_s=PATIENCE_S)
        player = LivePlayer(client, config=LivePlayerConfig(knows_physics=True))
        eventually(lambda: player.snapshot.t_us > 100_000, "0.1 s to be played")
        first = player.snapshot.session
        assert client.physics == told_physics(player) == physics_profile("paper")
    with serving_balls(address, seed=2, physics="real", width=320, height=240):
        eventually(
            lambda: player.snapshot.session not in ("", first) and player.snapshot.t_us > 100_000,
            "the successor's session to be played",
        )
        client.launch((1.0, 0.0, 0.3), (-4.0, 0.0, 1.0))
        eventually(lambda: player.snapshot.played == 1, "the ball to be judged")
        assert player.snapshot.problem == "" and len(player.snapshot.finished) == 1
        assert client.physics == told_physics(player) == physics_profile("real")
        player.use(BuiltInController())
        assert told_physics(player) == physics_profile("real"), "whoever plays is told"
    player.close()
    client.close()


def test_what_others_hear_while_nobody_listens_here_is_not_missing(rally) -> None:
    client, player, _ = rally
    other = SimulationClient(client.address, timeout_s=PATIENCE_S)
    other.wait_for_messages()
    client.listen(False)
    eventually(lambda: not client.state.ends_block, "a sign of life at rest")
    stood_us, dropped = player.snapshot.t_us, player._meter.dropped
    eventually(lambda: client.state.t_us - stood_us > 500_000, "50 blocks for the other listener")
    player.wake()
    client.listen(True)
    eventually(lambda: player.snapshot.t_us > stood_us + 500_000, "it to be played on")
    assert player._meter.dropped - dropped < 50  # of a busy machine, which may be too slow for the first ones
    other.close()


@pytest.mark.gate
def test_what_it_cannot_follow_is_dropped_and_nobody_waits_for_it(rally) -> None:
    """A listener holds the player up for 30 blocks at every prediction; link and simulation go on."""
    client, player, _ = rally
    eventually(lambda: player.snapshot.phase == "idle", "no ball to fly")
    dropped, went_on = player.snapshot.health.blocks_dropped, []

    def hold(*_: object) -> None:
        t_us = client.state.t_us
        eventually(lambda: client.state.t_us - t_us > 300_000, "30 blocks that nobody plays")
        went_on.append(True)

    player.add_listener(hold)
    client.serve(5.0)
    eventually(lambda: went_on, "the listener to go on")
    player.remove_listener(hold)
    eventually(lambda: player.snapshot.health.blocks_dropped > dropped + 10, "dropped blocks to be counted")
    eventually(lambda: client.state.t_us - player.snapshot.t_us <= 30_000, "the player to have caught up")
