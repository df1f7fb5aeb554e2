"""What it takes for a ball."""

from dataclasses import replace

import numpy as np
import pytest

from core.detection.refined.ball_fit import Quality
from core.detection.refined.patch import MovingCircle
from core.detection.refined.track import BallTrack, evidence_of, fit_limits, fit_values, is_within, passes
from core.detection.refined_config import RefinedConfig
from core.events import SensorSize

pytestmark = pytest.mark.numeric
CONFIG = RefinedConfig()
BALL = MovingCircle(100.0, 50.0, 2.0, 0.0, 10.0)
CLEAN = Quality(0.2, 120.0, 1.0, 1.0, 0.02, 0.1, 0.9, 5.0, 1.0, 0.33)
LIMB = Quality(0.43, 70.0, 0.9, 0.6, 0.15, 0.4, 0.58, 4.0, 1.0, 0.3)
"""Like the part of a person that a detector took for a ball for 100 ms."""


def flown(quality: Quality, fits: int, *, px_per_ms: float = 2.0, r_px: float = 10.0, grows: float = 0.0) -> BallTrack:
    track = BallTrack(0, BALL._replace(r=r_px), np.eye(6), quality)
    for ms in range(1, fits):
        ball = MovingCircle(100.0 + px_per_ms * ms, 50.0, px_per_ms, 0.0, r_px * (1 + grows * ms))
        track.take(1000 * ms, ball, np.eye(6), quality)
    return track


def test_a_clean_ball_is_proved_with_its_fourth_fit() -> None:
    assert not flown(CLEAN, 3).is_confirmed_by(CONFIG, 0.0)
    assert flown(CLEAN, 4).is_confirmed_by(CONFIG, 0.0)


def test_a_limb_never_is() -> None:
    assert evidence_of(LIMB) < 0 < evidence_of(CLEAN)
    assert not any(flown(LIMB, fits, px_per_ms=0.5).is_confirmed_by(CONFIG, 0.0) for fits in range(4, 200, 7))
    assert flown(LIMB, 40).is_terminated


def test_something_dark_needs_more_fits_and_more_again_after_a_bright_ball() -> None:
    dark = CLEAN._replace(brighter=-1.0, residual_px=0.3)
    needs = {
        before: next(fits for fits in range(1, 60) if flown(dark, fits, px_per_ms=1.0).is_confirmed_by(CONFIG, before))
        for before in (-1.0, 1.0)
    }
    bright = next(
        fits
        for fits in range(1, 60)
        if flown(dark._replace(brighter=1.0), fits, px_per_ms=1.0).is_confirmed_by(CONFIG, 1)
    )
    assert bright < needs[-1.0] < needs[1.0] == 16


@pytest.mark.parametrize(
    "unlike",
    [{"px_per_ms": 0.25}, {"grows": 0.05}, {"px_per_ms": 0.25, "r_px": 25.0}],
    ids=["slow for its size", "grows", "a head"],
)
def test_what_stays_in_its_place_or_grows_is_no_ball(unlike: dict[str, float]) -> None:
    assert not flown(CLEAN, 7, **unlike).is_confirmed_by(CONFIG, 0.0)


def test_something_dark_that_is_slow_is_no_ball_after_a_bright_one() -> None:
    hair = CLEAN._replace(brighter=-0.9, residual_px=0.3)
    slow, fast = (flown(hair, 60, px_per_ms=speed, r_px=20.0) for speed in (0.95, 2.5))
    assert not slow.is_confirmed_by(CONFIG, 1.0) and fast.is_confirmed_by(CONFIG, 1.0)
    assert slow.is_confirmed_by(CONFIG, -1.0), "as fast as a dark ball may be"
    assert [reason.setting for reason in slow.missing(CONFIG, 1.0)] == ["refined.pace_min_per_ms"]


def test_a_rough_first_fit_does_not_count_for_ever() -> None:
    slow = BallTrack(0, BALL._replace(u=102.5, vu=0.5), np.eye(6), CLEAN)
    for ms in range(1, 13):
        slow.take(1000 * ms, BALL._replace(u=100.0 + 0.5 * ms, vu=0.5), np.eye(6), CLEAN)
        if ms == 9:
            assert slow.missing(CONFIG, 0.0), "the first place is 2.5 px ahead of the ball's"
    assert slow.is_confirmed_by(CONFIG, 0.0)
    assert len(slow.places) == 11, "none is older than needed"


def test_half_a_disc_at_the_border_is_no_new_ball() -> None:
    for v_px, ready in ((6.0, False), (9.0, True)):
        track = BallTrack(0, BALL._replace(v=v_px), np.eye(6), CLEAN, sensor=SensorSize(320, 240))
        for ms in range(1, 12):
            track.take(1000 * ms, BALL._replace(u=100.0 + 2.0 * ms, v=v_px), np.eye(6), CLEAN)
        assert track.is_confirmed_by(CONFIG, 0.0) == ready


def test_another_thing_is_not_taken_for_the_same_ball() -> None:
    track = flown(CLEAN, 10)
    assert track.fits_in(track.ball, CLEAN)
    assert not track.fits_in(track.ball._replace(r=12.5), CLEAN), "too large"
    assert not track.fits_in(track.ball, CLEAN._replace(brighter=-1.0)), "a shadow"
    assert not track.fits_in(track.ball, CLEAN._replace(contrast=2.0)), "too pale"


@pytest.mark.parametrize(
    "worse",
    [
        {"residual_px": 0.6}, {"points": 11.0}, {"coverage_lead": 0.2}, {"coverage_lead": 0.4, "coverage_trail": 0.6},
        {"inside": 0.31}, {"fill": 0.3}, {"stray": 0.6}, {"fresh": 0.0},
    ],
)  # fmt: skip
def test_each_limit_of_a_single_fit_refuses(worse: dict[str, float]) -> None:
    assert passes(BALL, CLEAN, CONFIG)
    assert not passes(BALL, CLEAN._replace(**worse), CONFIG)


@pytest.mark.parametrize(
    "ball",
    [
        BALL._replace(r=2.9),
        BALL._replace(r=41.0),
        BALL._replace(vu=0.1),
        BALL._replace(vu=26),
        BALL._replace(stretch=3.0),
        BALL._replace(stretch=-0.3),
    ],
)
def test_so_do_sizes_and_speeds(ball: MovingCircle) -> None:
    assert not passes(ball, CLEAN, CONFIG)
    assert passes(BALL, CLEAN, replace(CONFIG, radius_min_px=9.9))


def test_a_known_ball_may_become_a_little_smaller_than_a_new_one_and_not_larger() -> None:
    limits = fit_limits(CONFIG, confirmed=True)
    assert all(is_within(fit_values(BALL._replace(r=r), CLEAN), limits) for r in (2.4, 39.0))
    assert not any(is_within(fit_values(BALL._replace(r=r), CLEAN), limits) for r in (2.0, 41.0))


def test_one_with_half_an_edge_or_on_changing_ground_is_not_proved() -> None:
    assert flown(CLEAN._replace(coverage_lead=0.4, residual_px=0.1), 20).evidence > CONFIG.evidence_min
    assert not flown(CLEAN._replace(coverage_lead=0.4, residual_px=0.1), 20).is_confirmed_by(CONFIG, 0.0)
    assert not flown(CLEAN._replace(brighter=0.3, residual_px=0.1), 20).is_confirmed_by(CONFIG, 0.0)


def test_it_moves_on_as_before() -> None:
    assert flown(CLEAN, 3).at(7000) == pytest.approx((114.0, 50.0, 2.0, 0.0, 10.0, 0.0, 0.0, 0.0))


def test_its_acceleration_is_that_of_its_velocities() -> None:
    turning = BallTrack(0, BALL._replace(vu=12.0), np.eye(6), CLEAN)
    for ms in range(1, 60):
        angle = 0.1 * ms
        ball = MovingCircle(0.0, 0.0, 12 * np.cos(angle), 12 * np.sin(angle), 10.0)
        turning.take(1000 * ms, ball, np.eye(6), CLEAN)
    toward = turning.bend @ np.array([-np.sin(angle), np.cos(angle)])
    assert toward == pytest.approx(1.2, rel=0.15)
    jump = BallTrack(0, BALL, np.eye(6), CLEAN)
    jump.take(1000, BALL._replace(vv=-2.0), np.eye(6), CLEAN)
    assert abs(jump.bend[1]) < 0.05, "no ball turns on the spot"
