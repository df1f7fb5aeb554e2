from dataclasses import replace

import numpy as np
import pytest

from core.chain.control import hit_choice
from core.chain.control.controller import BuiltInController
from core.chain.control.hit_choice import (
    FaceTrajectory,
    HitChoice,
    HitChoiceConfig,
    RacketReach,
    choose_hit,
    expected_covariance,
    plane_explanation,
)
from core.simulation.episodes.racket import RacketConfig
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory import Prediction
from core.trajectory.config import PaperPredictorConfig
from core.trajectory.prediction import predict_flight

CONFIG = HitChoiceConfig()
REACH = RacketReach.of_config(RacketConfig())
HOME = np.array(REACH.home_m)
LOW_BALL = (-0.8, 0.0, BALL_RADIUS_M), (-1.9, 0.0, 1.6)
"""Just after its bounce; it rises to 15 cm and comes down at the paper's plane."""
HIGH_BALL = (-0.8, 0.0, BALL_RADIUS_M), (-3.0, 0.0, 2.4)


def predicted(ball, *, seen_s: float = 0.05, config: PaperPredictorConfig | None = None) -> Prediction:
    """The prediction of a ball under gravity after its bounce at time 0, from what is seen of it."""
    t = np.linspace(0.005, seen_s, 12)
    p, v = np.array(ball[0]), np.array(ball[1])
    ps = p + v * t[:, None] - [[0, 0, GRAVITY_MPS2 / 2]] * t[:, None] ** 2
    precise = config or PaperPredictorConfig(sigma_point_m=0.0005)
    found = predict_flight(t, ps, round(1e6 * seen_s), "post", precise)
    assert found is not None
    return found


def choose(prediction: Prediction, *, reach: RacketReach = REACH, at_s: float = 0.07, kept_x_m: float | None = None):
    racket = FaceTrajectory(at_s, HOME, np.zeros(3))
    strokes = BuiltInController().strokes()
    return choose_hit(prediction, strokes, racket, reach, CONFIG, bounced_s=0.0, kept_x_m=kept_x_m)


def test_a_low_ball_is_met_over_the_table_and_the_plane_is_named_too_low() -> None:
    found = choose(predicted(LOW_BALL))
    assert found.chosen is not None and not found.why_not
    x, _, z = found.chosen.hit.p_world_m
    assert x > -1.37 and z > CONFIG.face_radius_m, "the face is clear of the table"
    assert found.chosen.chance > 0.9
    at_plane = next(one for one in found.candidates if one.hit.p_world_m[0] == hit_choice.PAPER_X_M)
    assert at_plane.why_not == hit_choice.BELOW and at_plane.chance == 0


def test_an_ordinary_ball_can_be_met_at_many_places_and_the_one_that_was_chosen_is_kept() -> None:
    flight = predicted(HIGH_BALL)
    found = choose(flight)
    possible = [one for one in found.candidates if not one.why_not]
    assert found.chosen is not None and len(possible) > 3
    other = next(one for one in possible if one is not found.chosen and one.chance > found.chosen.chance - 0.05)
    x_m = float(other.hit.p_world_m[0])
    kept = choose(flight, kept_x_m=x_m)
    assert kept.chosen is not None and kept.chosen.hit.p_world_m[0] == x_m


@pytest.mark.parametrize(
    ("reach", "at_s", "why_not"),
    [
        (replace(REACH, reach_m=0.05), 0.07, hit_choice.OUT_OF_REACH),
        (replace(REACH, low_m=(-3.0, 0.4, -1.0)), 0.07, hit_choice.OUT_OF_REACH),
        (replace(REACH, max_speed_mps=0.5), 0.07, hit_choice.TOO_SLOW),
        (REACH, 1.0, hit_choice.NO_TIME),
        (replace(REACH, max_acceleration_mps2=1.0), 0.07, hit_choice.NO_TIME),
    ],
)
def test_where_the_racket_cannot_be_the_choice_says_so(reach, at_s, why_not) -> None:
    found = choose(predicted(HIGH_BALL), reach=reach, at_s=at_s)
    assert found.chosen is None and found.why_not == why_not


def test_a_racket_on_its_way_is_not_called_late_for_the_place_it_goes_to() -> None:
    flight = predicted(HIGH_BALL)
    assert choose(flight, at_s=1.0).chosen is None
    kept = choose(flight, at_s=1.0, kept_x_m=-1.42)
    assert kept.chosen is not None and kept.chosen.hit.p_world_m[0] == -1.42


def test_after_a_second_bounce_the_ball_is_dead() -> None:
    found = choose(predicted(((-0.3, 0.0, BALL_RADIUS_M), (-1.2, 0.0, 0.8))))
    assert found.chosen is None and found.candidates
    assert all(one.why_not == hit_choice.TWICE for one in found.candidates)


def test_a_ball_that_goes_nowhere_near_has_no_candidates_and_a_reason() -> None:
    found = choose(predicted(((-0.3, 0.0, 0.3), (2.0, 0.0, 1.0))))
    assert found.candidates == () and found.why_not == "the ball does not come to the racket"


def test_before_the_bounce_a_place_too_soon_after_it_is_refused() -> None:
    t = np.linspace(0.0, 0.05, 12)
    p, v = np.array([-0.70, 0.0, 0.30]), np.array([-5.0, 0.0, -2.0])
    ps = p + v * t[:, None] - [[0, 0, GRAVITY_MPS2 / 2]] * t[:, None] ** 2
    flight = predict_flight(t, ps, 50_000, "pre", PaperPredictorConfig())
    assert flight is not None and flight.bounces
    found = choose_hit(flight, BuiltInController().strokes(), FaceTrajectory(0.07, HOME, np.zeros(3)), REACH, CONFIG)
    soon = [one for one in found.candidates if one.hit.t_s < flight.bounces[0].t_s + 1e-3 * CONFIG.see_ms]
    assert soon and all(one.why_not in (hit_choice.NOT_YET, hit_choice.TOO_SOON) for one in soon)
    assert found.chosen is not None and found.chosen.hit.t_s > flight.bounces[0].t_s


def test_waiting_longer_makes_the_ball_better_known_and_never_worse_than_it_is_now() -> None:
    coarse = predicted(HIGH_BALL, config=PaperPredictorConfig(sigma_point_m=0.02))
    hit = coarse.crossings([-1.42])[0]
    assert hit is not None
    sigmas = [np.sqrt(expected_covariance(hit, s, CONFIG).diagonal()) for s in (0.06, 0.10, 0.20)]
    assert (sigmas[0][1:] > sigmas[1][1:]).all() and (sigmas[1][1:] > sigmas[2][1:]).all()
    assert (sigmas[0] <= np.sqrt(hit.covariance.diagonal()) + 1e-12).all()
    assert expected_covariance(hit, float("nan"), CONFIG) is hit.covariance


def test_less_is_expected_of_a_ball_that_is_known_badly() -> None:
    strokes = BuiltInController().strokes()
    hit = predicted(HIGH_BALL).crossings([-1.42])[0]
    assert hit is not None
    known, vague = (strokes.stroke_at(hit, sigma**2 * np.eye(6)) for sigma in (0.001, 0.5))
    assert known is not None and vague is not None
    assert known.chance > 0.95 > 0.5 > vague.chance and known.landing_sigma_m < vague.landing_sigma_m


def test_the_racket_on_its_way_is_where_the_cubic_is() -> None:
    start = FaceTrajectory(0.0, HOME, np.zeros(3))
    goal, speed = HOME + np.array([0.2, 0.1, 0.0]), np.array([1.0, 0.0, 0.0])
    there = start.towards(0.4, goal, speed, 0.4 - 1e-9)
    np.testing.assert_allclose(there.p_m, goal, atol=1e-6)
    np.testing.assert_allclose(there.v_mps, speed, atol=1e-6)
    np.testing.assert_allclose(start.towards(0.4, goal, speed, 0.5).p_m, goal + 0.1 * speed)


def test_the_papers_plane_is_among_the_candidates() -> None:
    assert hit_choice.PAPER_X_M in CONFIG.xs_m and (np.diff(CONFIG.xs_m) < 0).all()
    assert CONFIG.xs_m[0] > -1.37 > CONFIG.xs_m[-1]


def test_why_no_stroke_returns_a_ball_is_said_in_words_with_the_place() -> None:
    assert choose(predicted(LOW_BALL)).explanation == ""
    nothing = choose(predicted(LOW_BALL), reach=replace(REACH, low_m=(-3.0, 0.4, -1.0)))
    assert nothing.chosen is None
    assert nothing.explanation.startswith("Ball cannot be returned: out of the racket's reach at x = -1.")
    assert HitChoice(0, None, (), "the ball does not come").explanation == (
        "Ball cannot be returned: the ball does not come"
    )
    low, high = (predicted(ball).crossings([hit_choice.PAPER_X_M])[0] for ball in (LOW_BALL, HIGH_BALL))
    assert low is not None and high is not None
    assert plane_explanation(low).startswith("Ball cannot be returned: below the table's top at x = -1.42 m, z = ")
    assert plane_explanation(high) == ""


def test_a_place_that_leaves_the_racket_no_reserve_is_not_kept_where_another_is_as_good() -> None:
    flight, config = predicted(HIGH_BALL), HitChoiceConfig(enough=0.05)
    strokes, racket = BuiltInController().strokes(), FaceTrajectory(0.07, HOME, np.zeros(3))
    nearest = next(one for one in choose(flight).candidates if not one.why_not)
    hit, stroke = nearest.hit, strokes.stroke_at(nearest.hit, np.zeros((6, 6)))
    assert stroke is not None
    hardest = max(np.linalg.norm(a) for a in racket.accelerations(hit.t_s, stroke.face_m, stroke.v_mps))
    for share, reserve, is_kept in ((1.2, 0.1, True), (1.05, 0.1, False), (1.05, 0.0, True), (1.05, 0.9, True)):
        reach, settings = replace(REACH, max_acceleration_mps2=share * hardest), replace(config, reserve=reserve)
        kept_x_m = float(hit.p_world_m[0])
        found = choose_hit(flight, strokes, racket, reach, settings, bounced_s=0.0, kept_x_m=kept_x_m).chosen
        assert found is not None and (found.hit.p_world_m[0] == kept_x_m) == is_kept
        assert is_kept or found.has_reserve


def test_a_place_long_enough_after_the_bounce_for_a_correction_is_taken_where_there_is_one() -> None:
    flight, racket = predicted(HIGH_BALL), FaceTrajectory(0.07, HOME, np.zeros(3))

    def since_s(correct_ms: float) -> float:
        config = HitChoiceConfig(enough=0.05, correct_ms=correct_ms)
        found = choose_hit(flight, BuiltInController().strokes(), racket, REACH, config, bounced_s=0.0).chosen
        assert found is not None
        return found.hit.t_s

    usual_s = since_s(0.0)
    assert since_s(300.0) > 0.3 > usual_s == since_s(55.0)
