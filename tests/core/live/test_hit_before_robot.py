"""Where balls are met before a robot: within the limits that it states, else at the paper's plane."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from core.chain.control.hit_choice import HitChoice, RacketReach
from core.live.link import messages as m
from core.live.live_player import LivePlayer, LivePlayerConfig
from core.live.replay_source import ReplaySource
from core.recordings import open_recording
from tests.waiting import eventually

BEHIND = RacketReach((-1.7, 0.0, 0.3), math.inf, (-2.0, -0.7, 0.05), (-1.5, 0.7, 0.8), 5.0, 60.0)
"""Limits of a robot whose box ends 13 cm behind the table."""


class SilentRobot:
    """A robot that does not state where it can go."""

    def aim_racket(self, p_m, q_wxyz, v_mps, t_us, cameras=()) -> m.Reply:
        return m.Reply(id=0, ok=True, session="", t_us=t_us, block_us=10_000)


class StatingRobot(SilentRobot):
    """A robot that states its limits when it is asked to."""

    reach: RacketReach | None = None


@contextmanager
def playing(recording: Path, robot: SilentRobot | None) -> Iterator[tuple[LivePlayer, list[HitChoice | None]]]:
    """A player that chooses before a looped serve, and the choice of every decision."""
    source = ReplaySource(open_recording(recording), "serve.h5")
    source.robot = robot  # pyright: ignore[reportAttributeAccessIssue]
    choices: list[HitChoice | None] = []
    player = LivePlayer(source, config=LivePlayerConfig(hit="chosen"))
    player.add_listener(lambda session, state, decision: choices.append(state.choice))
    try:
        yield player, choices
    finally:
        player.close()
        source.close()


def test_a_robot_that_states_no_limits_meets_balls_at_the_plane_only(serve_recording):
    with playing(serve_recording, SilentRobot()) as (player, choices):
        eventually(lambda: player.snapshot.health.commands_sent > 5, "commands")
        assert set(choices) == {None}


def test_the_choice_respects_limits_from_when_they_are_stated(serve_recording):
    robot = StatingRobot()
    with playing(serve_recording, robot) as (_, choices):
        eventually(lambda: len(choices) > 5, "predictions before it states any")
        assert set(choices) == {None}
        robot.reach = BEHIND
        eventually(lambda: any(one is not None and one.chosen for one in choices), "a choice")
        chosen = [one.chosen.hit.p_world_m[0] for one in choices if one is not None and one.chosen is not None]
        assert max(chosen) < -1.45, "the plane is outside of its box"


def test_a_source_without_a_robot_shows_what_the_simulated_racket_would_choose(serve_recording):
    with playing(serve_recording, None) as (_, choices):
        eventually(lambda: any(one is not None for one in choices), "a choice")
