"""What is shown of a flight whose hit was chosen before or behind the paper's plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from core.chain.control.controller import BuiltInController, RacketDecision
from core.chain.control.hit_choice import FaceTrajectory, HitChoice, HitChoiceConfig, RacketReach, choose_hit
from core.chain.control.player import PlayerState
from core.history.rally_history import RallyHistory
from core.history.recorded_rally import choice_rows, met_ball, read_choices
from core.history.shown_prediction import SAME_PLACE_M, meet_where_sent, shown_prediction
from core.simulation.episodes.racket import RacketConfig, target_for_ball
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory import Prediction
from core.trajectory.config import PaperPredictorConfig
from core.trajectory.prediction import predict_flight

SEEN_S = 0.05


def predicted(v_mps: tuple[float, float, float] = (-1.9, 0.0, 1.6)) -> Prediction:
    """Of a ball under gravity after its bounce at time 0; the usual one is below the table's top at the plane."""
    t = np.linspace(0.005, SEEN_S, 12)
    ps = np.array([-0.8, 0.0, BALL_RADIUS_M]) + np.outer(t, v_mps)
    ps[:, 2] -= GRAVITY_MPS2 / 2 * t**2
    found = predict_flight(t, ps, round(1e6 * SEEN_S), "post", PaperPredictorConfig(sigma_point_m=0.0005))
    assert found is not None
    return found


def chosen(prediction: Prediction, reach: RacketReach | None = None) -> HitChoice:
    reach = reach or RacketReach.of_config(RacketConfig())
    racket = FaceTrajectory(0.07, np.array(reach.home_m), np.zeros(3))
    return choose_hit(prediction, BuiltInController().strokes(), racket, reach, HitChoiceConfig(), bounced_s=0.0)


def decided(choice: HitChoice) -> RacketDecision:
    assert choice.chosen is not None
    hit = choice.chosen.hit
    found = BuiltInController().decide(hit.t_s, hit.p_world_m, hit.v_world_mps, stage="post")
    assert found is not None
    return found


def moment_of(
    prediction: Prediction,
    decision: RacketDecision | None,
    choice: HitChoice | None,
    recorded: Sequence[HitChoice] = (),
):
    chain = SimpleNamespace(
        t_us=prediction.t_us,
        detections={},
        used=frozenset(),
        is_new=True,
        prediction=prediction,
        point=None,
        verdict=None,
        seconds=SimpleNamespace(total=0.0),
    )
    history = RallyHistory()
    history.add_choices(recorded)
    history.add_step(PlayerState(chain, decision, True, 0.0, choice))  # type: ignore[arg-type]
    return history, history.at(prediction.t_us, {})


def test_the_flight_is_shown_up_to_where_it_is_to_be_hit_with_the_other_places() -> None:
    prediction = predicted((-1.9, 0.0, 1.9))
    choice = chosen(prediction)
    history, moment = moment_of(prediction, decided(choice), choice)
    picture, hit = moment.picture, choice.chosen.hit  # type: ignore[union-attr]
    assert hit.p_world_m[0] > -1.37, "over the table"
    np.testing.assert_allclose(picture.hit, hit.p_world_m, atol=1e-6)
    np.testing.assert_allclose(picture.after_bounce[-1], hit.p_world_m, atol=1e-3)
    assert picture.hit_in_s == pytest.approx(hit.t_s - SEEN_S)
    np.testing.assert_allclose(picture.spreads[-1].centre, hit.p_world_m, atol=1e-6)
    assert history.predicted_hits()[-1][1].p_world_m[0] == pytest.approx(hit.p_world_m[0])
    assert len(picture.hit_places) + len(picture.refused_places) == len(choice.candidates) - 1
    assert len(picture.hit_places) and len(picture.refused_places) and picture.no_stroke == ""


def test_at_the_paper_s_plane_a_low_ball_is_said_to_be_too_low_and_nothing_else_is_shown() -> None:
    low, high = predicted(), predicted((-3.0, 0.0, 2.4))
    at_plane = low.hit_plane
    assert at_plane is not None
    decision = BuiltInController().decide(0.4, (-1.42, 0.0, 0.2), (-3.0, 0.0, -1.0), stage="post")
    assert decision is not None
    _, moment = moment_of(low, decision, None)
    assert moment.picture.no_stroke.startswith("Ball cannot be returned: below the table's top")
    assert len(moment.picture.hit_places) == len(moment.picture.refused_places) == 0
    np.testing.assert_array_equal(moment.picture.hit, at_plane.p_world_m)
    assert moment_of(high, decision, None)[1].picture.no_stroke == ""
    assert moment_of(low, None, None)[1].picture.no_stroke == "", "no racket, nothing to return it"


def test_where_no_stroke_returns_it_the_reason_is_shown() -> None:
    prediction = predicted()
    reach = replace(RacketReach.of_config(RacketConfig()), reach_m=0.01)
    choice = chosen(prediction, reach)
    assert choice.chosen is None
    shown = shown_prediction(prediction, None, choice)
    assert shown.no_stroke == choice.explanation and "out of the racket's reach" in shown.no_stroke
    assert shown.hit is prediction.hit_plane


def test_a_recording_shows_the_hit_where_the_racket_was_sent_and_not_that_of_the_ball_before() -> None:
    prediction = predicted()
    decision = decided(chosen(prediction))
    face = decision.target
    recorded = replace(decision, state=np.concatenate([met_ball(face.p_m, face.q_wxyz), np.full(3, np.nan)]))
    shown = meet_where_sent(prediction, recorded)
    assert shown.hit_plane is not None
    assert abs(shown.hit_plane.p_world_m[0] - decision.state[0]) < SAME_PLACE_M
    before = replace(recorded, target=replace(face, t_s=SEEN_S - 0.01))
    assert meet_where_sent(prediction, before) is prediction
    at_plane = replace(recorded, state=np.array([-1.42, 0, 0, 0, 0, 0]))
    assert meet_where_sent(prediction, at_plane) is prediction, "the same value, to the last bit"


def test_the_ball_that_touches_a_face_is_the_inverse_of_the_face_for_a_ball() -> None:
    p, q = np.array([-1.2, 0.1, 0.3]), np.array([0.9, 0.1, -0.3, 0.2])
    q /= np.linalg.norm(q)
    np.testing.assert_allclose(met_ball(target_for_ball(p, q, np.zeros(3), 0.0).p_m, q), p, atol=1e-12)


def test_a_recording_that_keeps_its_choices_shows_the_places_and_why_there_is_none() -> None:
    prediction = predicted()
    reach = replace(RacketReach.of_config(RacketConfig()), reach_m=0.01)
    made = [chosen(prediction), replace(chosen(prediction, reach), t_us=prediction.t_us + 1)]
    rows = [choice_rows(one, 0) for one in made]
    assert rows[0] is not None and rows[1] is not None
    both = {name: np.concatenate([rows[0][name], rows[1][name]]) for name in rows[0]}
    first, second = read_choices(SimpleNamespace(read_rows=lambda group: both))
    assert first.chosen is not None and made[0].chosen is not None
    np.testing.assert_array_equal(first.chosen.hit.p_world_m, made[0].chosen.hit.p_world_m)
    assert [one.why_not for one in first.candidates] == [one.why_not for one in made[0].candidates]
    assert second.explanation == made[1].explanation != ""
    _, shown = moment_of(prediction, decided(made[0]), None, [first])
    _, live = moment_of(prediction, decided(made[0]), made[0])
    np.testing.assert_array_equal(shown.picture.hit_places, live.picture.hit_places)
    assert moment_of(prediction, None, None, [replace(second, t_us=0)])[1].picture.no_stroke == made[1].explanation
    passed = replace(prediction, t_us=round(1e6 * made[0].candidates[-1].hit.t_s) + 1)
    assert moment_of(passed, None, None, [second])[1].picture.no_stroke == "", "that was the ball before"
    assert read_choices(SimpleNamespace(read_rows=lambda group: None)) == ()
