"""Balls of known state against the simulated robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core.live.worlds.simulated_returns import (
    ReturnOutcome,
    SimulatedReturnsConfig,
    play_recorded_states,
)
from core.physics import Serves
from core.physics.ball_states import join_serves, read_ball_states
from core.physics.task import task_profile
from core.simulation.episodes import draw_serves
from core.simulation.episodes.incoming import Incoming
from core.simulation.episodes.racket import RacketConfig

pytestmark = pytest.mark.numeric
REAL = task_profile("real")
CONFIG = SimulatedReturnsConfig(task=REAL)


def launched(p: tuple[float, ...], v: tuple[float, ...]) -> Serves:
    return Serves(np.array([p]), np.array([v]), np.zeros((1, 3)))


@pytest.fixture(scope="module")
def serves() -> Serves:
    return draw_serves(6.0, 20, REAL, np.random.default_rng(3))


def test_with_perfect_knowledge_every_serve_comes_back_to_the_target(serves: Serves) -> None:
    played = play_recorded_states(serves, CONFIG)
    assert (played.fate == ReturnOutcome.RETURNED).all()
    assert np.median(played.error_m) < 0.002


def test_balls_with_much_spin_too_because_the_spin_is_known(serves: Serves) -> None:
    spinning = Serves(serves.ps_m, serves.vs_mps, np.tile([0.0, -80.0, 30.0], (len(serves), 1)))
    played = play_recorded_states(spinning, CONFIG)
    playable = played.incoming == Incoming.PLAYABLE
    assert playable.sum() > 10 and (played.fate[playable] == ReturnOutcome.RETURNED).mean() > 0.9
    assert np.nanmedian(played.error_m) < 0.005


def test_each_way_of_losing_a_ball_has_its_name(serves: Serves) -> None:
    into_the_net, wide = launched((1.0, 0.0, 0.1), (-5.0, 0.0, 0.8)), launched((1.0, 0.0, 0.5), (-4.0, 3.0, 1.0))
    played = play_recorded_states(join_serves([into_the_net, wide]), CONFIG)
    assert played.fate.tolist() == [ReturnOutcome.NOT_PLAYABLE] * 2
    assert played.incoming.tolist() == [Incoming.NET, Incoming.NO_BOUNCE]
    slow_arm = replace(CONFIG, racket=RacketConfig(max_speed_mps=5.0, max_acceleration_mps2=5.0))
    assert play_recorded_states(serves, slow_arm).count(ReturnOutcome.NO_TIME) > 5
    told_late = replace(CONFIG, told_after_ms=550.0)
    assert play_recorded_states(serves, told_late).count(ReturnOutcome.NO_TIME) > 5
    short_arm = replace(CONFIG, racket=RacketConfig(reach_m=0.15))
    assert play_recorded_states(serves, short_arm).count(ReturnOutcome.OUT_OF_REACH) > 5


def test_the_simulation_s_step_does_not_decide(serves: Serves) -> None:
    coarse, fine = (play_recorded_states(serves[:8], replace(CONFIG, step_ms=step)) for step in (10.0, 2.0))
    np.testing.assert_array_equal(coarse.fate, fine.fate)
    np.testing.assert_allclose(coarse.error_m, fine.error_m, atol=2e-4)


def test_most_recorded_balls_come_back(shared_data: Path) -> None:
    balls = read_ball_states(shared_data / "trajectories" / "deepmind_rally_ball_states.json")
    played = play_recorded_states(balls[np.random.default_rng(1).permutation(len(balls))[:60]], CONFIG)
    playable = played.incoming == Incoming.PLAYABLE
    assert playable.mean() > 0.7 and (played.fate[playable] == ReturnOutcome.RETURNED).mean() > 0.9


def test_balls_below_the_table_s_top_at_the_plane_come_back_where_the_hit_is_chosen() -> None:
    slow = draw_serves(3.0, 12, REAL, np.random.default_rng(4))
    at_plane, chosen = (play_recorded_states(slow, replace(CONFIG, hit=rule)) for rule in ("paper", "chosen"))
    assert at_plane.count(ReturnOutcome.RETURNED) < chosen.count(ReturnOutcome.RETURNED) >= 11
    assert np.nanmedian(chosen.error_m) < 0.02
    short_arm = replace(CONFIG, hit="chosen", racket=RacketConfig(reach_m=0.1))
    assert play_recorded_states(slow, short_arm).count(ReturnOutcome.OUT_OF_REACH) > 5
    into_the_net = launched((1.0, 0.0, 0.1), (-5.0, 0.0, 0.8))
    assert play_recorded_states(into_the_net, replace(CONFIG, hit="chosen")).incoming.tolist() == [Incoming.NET]
