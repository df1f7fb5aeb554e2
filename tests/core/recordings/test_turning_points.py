"""Bounces and hits of a known ball."""

import numpy as np

from core.recordings import BallTruth, PixelTruth
from core.recordings.truth import first_seen_us, turning_points


def flight(bounce_s: float, hit_s: float, *, step_us: int = 1000) -> BallTruth:
    """Falls, bounces, flies back after the hit; one second."""
    t_us = np.arange(0, 1_000_000, step_us, dtype=np.int64)
    t_s = t_us / 1e6
    vx = np.where(t_s < hit_s, -5.0, 6.0)
    vz = np.where(t_s < bounce_s, -9.81 * t_s - 0.5, 2.0 - 9.81 * (t_s - bounce_s))
    v = np.stack([vx, np.zeros_like(vx), vz], axis=1)
    nothing = np.zeros_like(v)
    return BallTruth(t_us, nothing, v, nothing, np.ones(len(t_us), np.bool_))


def test_a_bounce_and_a_hit_are_found_to_the_sample() -> None:
    found = turning_points(flight(0.4, 0.7))
    assert found.bounces_us.tolist() == [400_000] and found.hits_us.tolist() == [700_000]


def test_the_top_of_a_flight_is_no_bounce_and_a_gap_says_nothing() -> None:
    ball = flight(0.4, 0.7)
    assert len(turning_points(ball).bounces_us) == 1  # it passes a top after the bounce
    visible = ball.visible.copy()
    visible[395:405] = False
    hidden = BallTruth(ball.t_us, ball.p_world_m, ball.v_world_mps, ball.spin_radps, visible)
    assert len(turning_points(hidden).bounces_us) == 0
    assert len(turning_points(flight(0.4, 0.7, step_us=50_000)).bounces_us) == 0


def test_nothing_is_known_of_no_ball() -> None:
    empty = BallTruth(np.empty(0, np.int64), *(np.empty((0, 3)),) * 3, np.empty(0, np.bool_))
    found = turning_points(empty)
    assert len(found.bounces_us) == len(found.hits_us) == 0


def seen_from(start: int | None) -> PixelTruth:
    t_us = np.arange(0, 1000, 100, dtype=np.int64)
    visible = t_us >= (10**9 if start is None else start)
    return PixelTruth(t_us, *(np.where(visible, 5.0, np.nan),) * 3, visible)


def test_the_first_ball_is_there_when_every_camera_sees_it() -> None:
    assert first_seen_us([seen_from(300), seen_from(500), None]) == 500
    assert first_seen_us([seen_from(300), seen_from(None)]) is None
    assert first_seen_us([]) is None and first_seen_us([None]) is None
