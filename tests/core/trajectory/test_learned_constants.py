"""What is carried from ball to ball where nobody says how balls fly and bounce."""

from dataclasses import replace

import numpy as np
import pytest

from core.physics.config import PhysicsConfig, physics_profile
from core.physics.fit_flights import simulate_flight
from core.trajectory import FilterPredictor, filter_for
from core.trajectory.ball_filter import BallFilter
from core.trajectory.ball_kernel import DRAG
from core.trajectory.filter_config import PAPER, UNKNOWN
from core.trajectory.learned_constants import FEWEST_POINTS, LearnedConstants, nothing_learned

pytestmark = pytest.mark.numeric
UNTOLD = replace(filter_for("paper"), perhaps_real=True)


def lab(drag: float, restitution: float, friction: float) -> PhysicsConfig:
    real = physics_profile("real")
    table = replace(real.table, restitution=restitution, friction=friction)
    return replace(real, air=replace(real.air, drag_coefficient=drag), table=table)


def watch(predictor: FilterPredictor, physics: PhysicsConfig, balls: int, points: int = 170) -> LearnedConstants:
    """Spinless serves at 330 points/s with half a millimetre of noise."""
    rng = np.random.default_rng(4)
    for _ in range(balls):
        predictor.forget_flight()
        start = np.array([1.3, 0.1, 0.35, -rng.uniform(4, 8), rng.normal(0, 0.2), rng.uniform(0, 0.8), 0, 0, 0])
        t_s = 0.003 * np.arange(points)
        ps = simulate_flight(start, t_s, physics) + rng.normal(0, 0.0005, (points, 3))
        for t, p in zip(t_s, ps, strict=True):
            predictor.add(round(1e6 * t), p, 0.0005**2 * np.eye(3))
    predictor.forget_flight()
    return predictor.learned


@pytest.mark.parametrize("truth", [(0.42, 0.95, 0.29), (0.58, 0.88, 0.15)])
def test_what_is_not_told_is_learnt_from_some_balls(truth) -> None:
    predictor = FilterPredictor(UNTOLD)
    before = predictor.learned
    np.testing.assert_allclose(before.means, [UNKNOWN["drag"], UNKNOWN["restitution"], UNKNOWN["friction"]])
    found = watch(predictor, lab(*truth), 6)
    off, off_before = np.abs(found.means - truth), np.abs(before.means - truth)
    assert (off < [0.03, 0.015, 0.03]).all() and (off < 0.5 * off_before).all()
    assert (found.sigmas < 0.7 * before.sigmas).all() and (off < 3 * np.hypot(found.sigmas, 0.01)).all()
    assert found.balls == 6 and found.air > 0.95


def test_that_there_is_no_air_is_learnt_too_and_nothing_of_drag_then() -> None:
    found = watch(FilterPredictor(UNTOLD), physics_profile("paper"), 4)
    assert found.air < 0.05
    assert found.means[0] == UNKNOWN["drag"] and found.sigmas[0] == pytest.approx(UNKNOWN["drag_sigma"])
    assert (np.abs(found.means[1:] - [0.90, 0.15]) < [0.015, 0.03]).all()


def test_a_slow_ball_on_a_smoother_table_than_assumed_is_given_its_own_spin() -> None:
    """By the assumed friction it would leave the table rolling, with half as much spin again."""
    predictor = FilterPredictor(UNTOLD)
    start, t_s = np.array([1.3, 0.0, 0.35, -2.7, 0, 0.9, 0, 0, 0]), 0.003 * np.arange(240)
    ps = simulate_flight(start, t_s, physics_profile("paper"))
    for t, p in zip(t_s, ps, strict=True):
        predictor.add(round(1e6 * t), p, 0.0005**2 * np.eye(3))
    assert predictor.stage == "post"
    pushed_mps = float((ps[-1] - ps[-11])[0] / (t_s[-1] - t_s[-11])) - start[3]
    assert predictor.state[7] == pytest.approx(-75.0 * pushed_mps, abs=5.0)
    predictor.forget_flight()
    assert predictor.learned.means[2] < 0.18


def test_the_next_ball_begins_with_what_was_learnt_and_reset_takes_it_away() -> None:
    predictor = FilterPredictor(UNTOLD)
    found = watch(predictor, lab(0.42, 0.95, 0.29), 3)
    for config, odds in found.kinds(UNTOLD):
        assert config.restitution == pytest.approx(found.means[1]) and config.friction == pytest.approx(found.means[2])
        assert config.restitution_sigma > found.sigmas[1], "balls scatter"
        assert config.drag == (PAPER["drag"] if config.magnus == 0 else pytest.approx(found.means[0]))
        assert 0 < odds < 1
    assert sum(odds for _, odds in found.kinds(UNTOLD)) == pytest.approx(1.0)
    predictor.reset()
    start = nothing_learned(UNTOLD)
    np.testing.assert_array_equal(predictor.learned.means, start.means)
    assert predictor.learned.balls == 0


@pytest.mark.parametrize("strays", [2, 40])
def test_a_flight_that_ends_with_a_hit_teaches_as_much(strays: int) -> None:
    """The first points after it fit no flight that was seen; after some of them the filter begins anew by itself."""
    taught = []
    for back in (0, strays):
        predictor = FilterPredictor(UNTOLD)
        watch(predictor, lab(0.42, 0.95, 0.29), 1)
        start = np.array([1.3, 0.1, 0.35, -5.0, 0.1, 0.5, 0, 0, 0])
        ps = simulate_flight(start, 0.003 * np.arange(170), lab(0.42, 0.95, 0.29))
        away = ps[-1] + 0.03 * np.arange(1, back + 1)[:, None] * [1.0, 0.0, 0.1]
        for number, p in enumerate(np.concatenate([ps, away])):
            predictor.add(3000 * number, p, 0.0005**2 * np.eye(3))
        before = predictor.learned.balls
        predictor.forget_flight()
        assert predictor.learned.balls >= 2 and (before == 1) == (back < 5)
        taught.append(predictor.learned)
    np.testing.assert_allclose(taught[1].means[1:], taught[0].means[1:], atol=0.004)


def test_some_points_teach_nothing() -> None:
    predictor = FilterPredictor(UNTOLD)
    assert watch(predictor, lab(0.42, 0.95, 0.29), 3, points=15).balls == 0


def test_a_filter_that_is_told_learns_nothing() -> None:
    predictor = FilterPredictor(filter_for("real"))
    assert watch(predictor, lab(0.42, 0.95, 0.29), 2).balls == 0


@pytest.mark.parametrize("side", [-1, 1])
def test_a_flight_far_off_moves_the_constants_as_one_three_sigmas_off_does(side: int) -> None:
    start = nothing_learned(UNTOLD)
    moved = []
    for sigmas in (3.0, 5.0):
        ball = BallFilter(UNTOLD, 0, np.zeros(3), np.eye(3), needs_tick=False, odds=1.0)
        ball.points = FEWEST_POINTS
        ball.state[DRAG : DRAG + 3] = start.means + side * sigmas * np.hypot(start.sigmas, start.scatter)
        moved.append(start.after(ball, 1.0, 1.0).means - start.means)
    np.testing.assert_allclose(moved[1], moved[0])
    assert (side * moved[0] > 0).all()
