from dataclasses import replace

import numpy as np
import pytest

from core.errors import ConfigError
from core.physics.config import physics_profile
from core.physics.fit_flights import simulate_flight
from core.table import BALL_RADIUS_M, REAL_DRAG, REAL_FRICTION, REAL_RESTITUTION, TABLE_WIDTH_M
from core.trajectory import FilterConfig, FilterPredictor, filter_for
from core.trajectory.ball_filter import TYPICAL, BallFilter
from core.trajectory.ball_kernel import LIFT, TOUCHES, fly_and_bounce, touches
from core.trajectory.filter_kernel import ProcessNoise, move
from core.trajectory.observation import PointObservation

pytestmark = pytest.mark.numeric
START = np.array([1.2, 0.1, 0.30, -5.0, 0.2, 1.0, 20.0, -80.0, 40.0])
REAL = np.array([REAL_DRAG.value, REAL_RESTITUTION.value, REAL_FRICTION.value, 0.0, 0.0])
"""Drag, restitution, friction of the simulated profile; the table is where it should be, and so are observations."""


def path(state: np.ndarray, t_s: np.ndarray, magnus: float = 0.10) -> np.ndarray:
    states, s, now = [], state.copy(), 0.0
    for t in t_s:
        fly_and_bounce(s, t - now, LIFT * magnus)
        now = t
        states.append(s.copy())
    return np.array(states)


def test_the_kernel_flies_and_bounces_like_the_simulation() -> None:
    t_s = np.linspace(0.001, 0.599, 599)
    ours = path(np.concatenate([START, REAL]), t_s)
    theirs = simulate_flight(START, t_s, physics_profile("real"))
    assert (np.diff(np.sign(ours[:, 5])) > 0).any(), "there is a bounce"
    np.testing.assert_allclose(ours[:, :3], theirs, atol=1e-5)


def test_touches_are_where_the_path_is() -> None:
    state = np.concatenate([START, REAL])
    found = np.empty((1, TOUCHES))
    touches(state[None], 2.0, -1.42, LIFT * 0.10, found)
    bounce, landing, hit = found[0, :4], found[0, 8:12], found[0, 12:19]
    np.testing.assert_allclose(bounce, landing, rtol=0, atol=1e-12)
    assert bounce[3] == pytest.approx(BALL_RADIUS_M, abs=1e-9)
    at_hit = path(state, np.array([hit[0] - 2.0]))[0]
    np.testing.assert_allclose(at_hit[:6], hit[1:], atol=1e-5)
    assert hit[1] == -1.42


def test_a_noiseless_flight_gives_back_its_spin_and_its_hitting_point() -> None:
    t_s = np.arange(0, 500) * 1e-3
    truth = path(np.concatenate([START, REAL]), t_s)
    predictor = FilterPredictor(FilterConfig(sigma_point_m=1e-4, air_noise=0.0, bounce_noise_mps=0.0))
    for t, p in zip(t_s, truth[:, :3], strict=True):
        predictor.add(round(1e6 * t), p)
    found = np.empty((1, TOUCHES))
    touches(np.concatenate([START, REAL])[None], 0.0, -1.42, LIFT * 0.10, found)
    latest = predictor.predict()
    assert predictor.stage == "post" and len(predictor.bounces_us) == 1
    assert predictor.bounces_us[0] == pytest.approx(1e6 * found[0, 0], abs=200)
    assert latest is not None and latest.hit_plane is not None
    np.testing.assert_allclose(latest.hit_plane.p_world_m, found[0, 13:16], atol=0.001)
    assert latest.hit_plane.t_s == pytest.approx(found[0, 12], abs=2e-4)
    np.testing.assert_allclose(predictor.state[6:9], truth[-1, 6:9], atol=15.0)


def test_a_slow_ball_is_expected_to_bounce_twice_where_a_simulation_lets_it() -> None:
    start = np.array([1.0, 0.1, 0.30, -2.2, 0.1, 0.5, 0.0, 0.0, 0.0])
    t_s = np.arange(0, 1.1, 1e-4)
    ps = simulate_flight(start, t_s, physics_profile("real"))
    lowest = np.flatnonzero((ps[1:-1, 2] < ps[:-2, 2]) & (ps[1:-1, 2] <= ps[2:, 2])) + 1
    assert len(lowest) == 2 and (ps[lowest, 0] > -1.37).all()
    predictor = FilterPredictor(FilterConfig(sigma_point_m=1e-4, air_noise=0.0, bounce_noise_mps=0.0))
    for row in range(0, int(lowest[0]) - 300, 10):
        predictor.add(round(1e6 * t_s[row]), ps[row])
    latest = predictor.predict()
    assert latest is not None and latest.stage == "pre" and len(latest.bounces) == 2
    for bounce, row in zip(latest.bounces, lowest, strict=True):
        assert bounce.t_s == pytest.approx(t_s[row], abs=0.004)
        np.testing.assert_allclose(bounce.p_world_m, [*ps[row, :2], BALL_RADIUS_M], atol=0.01)
    one, two = latest.bounces
    assert np.all(two.sigma_m[:2] > one.sigma_m[:2]), "the second is less certain"
    assert latest.landing is not None and latest.landing.t_s == one.t_s


def fly_up(state: np.ndarray, seconds: float, step_ms: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    t_s = np.arange(0, seconds, step_ms * 1e-3)
    return t_s, path(state, t_s)


def feed(predictor: FilterPredictor, t_s: np.ndarray, ps: np.ndarray) -> FilterPredictor:
    for t, p in zip(t_s, ps, strict=True):
        predictor.add(round(1e6 * t), p)
    return predictor


def test_the_covariance_is_honest_before_and_after_the_bounce() -> None:
    rng = np.random.default_rng(3)
    config = FilterConfig(sigma_point_m=0.001, air_noise=0.0, bounce_noise_mps=0.0)
    names = ("drag", "restitution", "friction")
    priors = [getattr(config, name) for name in names]
    sigmas = [getattr(config, f"{name}_sigma") for name in names]
    before, after = [], []
    for _ in range(80):
        velocity = [-rng.uniform(4, 6), rng.normal(0, 0.3), rng.uniform(0.5, 1.2)]
        spin = rng.normal(0, config.spin_sigma_radps, 3)
        higher = rng.normal(0, config.table_sigma_m)
        state = np.array([1.2, 0.0, 0.3, *velocity, *spin, *rng.normal(priors, sigmas), higher, 0.0])
        t_s, truth = fly_up(state, 0.60, 2.0)
        bounced = int(np.argmax(np.diff(truth[:, 5]) > 0.5)) + 1
        predictor = FilterPredictor(config)
        for k, t in enumerate(t_s[: bounced + 20]):
            predictor.add(round(1e6 * t), truth[k, :3] + rng.normal(0, 0.001, 3))
            if k in (bounced - 20, bounced + 19):
                off = predictor.state[:6] - truth[k, :6]
                nees = off @ np.linalg.solve(predictor.covariance[:6, :6], off) / 6
                (before if k < bounced else after).append(nees)
    assert len(before) == len(after) == 80
    assert 0.8 < np.mean(before) < 1.2
    assert 0.8 < np.mean(after) < 1.2


def test_the_noise_is_learnt_along_each_axis() -> None:
    rng = np.random.default_rng(4)
    t_s, truth = fly_up(np.concatenate([START, REAL]), 0.34)
    noise = np.array([0.003, 0.0005, 0.001])
    predictor = feed(
        FilterPredictor(FilterConfig(sigma_point_m=0.001)), t_s, truth[:, :3] + rng.normal(0, noise, (340, 3))
    )
    np.testing.assert_allclose(np.sqrt(predictor.noise_scales), [3, 0.5, 1], rtol=0.15)
    fixed = feed(FilterPredictor(FilterConfig(adapt_points=0)), t_s, truth[:, :3])
    np.testing.assert_array_equal(fixed.noise_scales, 1.0)


@pytest.mark.parametrize(("higher_m", "restitution"), [(0.0, 0.945), (-0.005, 0.945), (0.005, 0.945), (0.0, 0.85)])
def test_the_bounce_is_found_where_it_is_and_not_where_it_was_expected(higher_m, restitution) -> None:
    rng = np.random.default_rng(5)
    state = np.concatenate([START, [REAL[0], restitution, REAL[2], higher_m, 0.0]])
    t_s, truth = fly_up(state, 0.45)
    fell = truth[:, 5] < 0
    bounced = int(np.argmax(fell[:-1] & (np.diff(truth[:, 5]) > 0.5))) + 1
    predictor = feed(
        FilterPredictor(FilterConfig(sigma_point_m=0.001)),
        t_s[: bounced + 30],
        truth[: bounced + 30, :3] + rng.normal(0, 0.001, (bounced + 30, 3)),
    )
    assert predictor.stage == "post" and len(predictor.bounces_us) == 1
    assert predictor.bounces_us[0] == pytest.approx(1e6 * t_s[bounced], abs=1500)
    np.testing.assert_allclose(predictor.state[3:6], truth[bounced + 29, 3:6], atol=0.12)
    found = np.empty((1, TOUCHES))
    touches(truth[bounced + 29][None], 0.0, -1.42, LIFT * 0.10, found)
    latest = predictor.predict()
    assert latest is not None and latest.hit_plane is not None
    np.testing.assert_allclose(latest.hit_plane.p_world_m, found[0, 13:16], atol=0.03)


@pytest.mark.parametrize("past_m", [-0.01, 0.01, 0.10])
def test_a_ball_past_the_edge_does_not_bounce_and_one_just_on_it_does(past_m) -> None:
    rng = np.random.default_rng(6)
    # Comes down 1 cm on this side of the side line, or beyond it.
    straight = np.concatenate([[1.2, 0.0, 0.30, -5.0, 0.0, 1.0, 0.0, 0.0, 0.0], REAL])
    t_s, truth = fly_up(straight, 0.45)
    truth[:, 1] += TABLE_WIDTH_M / 2 + past_m
    if past_m > 0:
        landed = int(np.argmax(np.diff(truth[:, 5]) > 0.5))
        falling = path(np.concatenate([truth[landed, :2] + [0, 1.0], truth[landed, 2:]]), t_s[: len(t_s) - landed])
        truth[landed + 1 :, 2] = falling[: len(t_s) - landed - 1, 2]
    predictor = FilterPredictor(FilterConfig(sigma_point_m=0.001))
    for t, p in zip(t_s, truth[:, :3], strict=True):
        if p[2] > -0.1:
            predictor.add(round(1e6 * t), p + rng.normal(0, 0.001, 3))
    assert predictor.stage == ("pre" if past_m > 0 else "post")
    assert (predictor.state[5] < -1) == (past_m > 0)


def test_a_flight_that_the_model_does_not_describe_is_noticed_and_its_spread_is_wider() -> None:
    rng = np.random.default_rng(7)
    t_s, truth = fly_up(np.concatenate([START, REAL]), 0.30, 5.0)
    noise = rng.normal(0, 0.001, (len(t_s), 3))
    wavering = truth[:, :3] + np.outer(0.012 * np.sin(2 * np.pi * t_s / 0.15), [1.0, 0.0, 1.0])
    sigmas, missed = [], []
    for ps in (truth[:, :3], wavering):
        prediction = feed(FilterPredictor(FilterConfig(sigma_point_m=0.001)), t_s, ps + noise).predict()
        assert prediction is not None and prediction.landing is not None
        sigmas.append(float(prediction.landing.sigma_m[0]))
        bounce = path(np.concatenate([START, REAL]), np.array([prediction.landing.t_s]))[0, :3]
        missed.append(abs(prediction.landing.p_world_m[0] - bounce[0]))
    assert sigmas[1] > 2 * sigmas[0]
    assert missed[1] < 4 * sigmas[1]


def test_air_and_spin_are_noticed_where_they_may_be() -> None:
    rng = np.random.default_rng(8)
    config = replace(filter_for("paper", sigma_point_m=0.001), perhaps_real=True)
    still = np.array([0.0, 0.90, 0.15, 0.0, 0.0])
    t_s = np.arange(0, 0.30, 0.002)
    for state, magnus in (
        (np.concatenate([START, REAL]), 0.10),
        (np.concatenate([START[:6], np.zeros(3), still]), 0.0),
    ):
        truth = path(state, t_s, magnus)[:, :3]
        predictor = feed(FilterPredictor(config), t_s, truth + rng.normal(0, 0.001, truth.shape))
        assert (predictor.state[9] > 0.4) == (magnus > 0)
        prediction = predictor.predict()
        assert prediction is not None and prediction.landing is not None
        found = np.empty((1, TOUCHES))
        touches(state[None], 0.0, -1.42, LIFT * magnus, found)
        np.testing.assert_allclose(prediction.landing.p_world_m, found[0, 9:12], atol=0.006)


def test_every_kind_of_flight_that_is_possible_has_its_share_of_the_prediction() -> None:
    config = replace(filter_for("paper", sigma_point_m=0.001), perhaps_real=True)
    truth = path(np.concatenate([START, REAL]), np.arange(0, 0.24, 0.002))[:, :3]
    predictor, shares = FilterPredictor(config), []
    assert predictor.air == predictor.learned.air > 0
    for number, p in enumerate(truth):
        predictor.add(2000 * number, p)
        shares.append([weight for _, weight in predictor.shares()])
    assert len(shares[0]) > 1 and sum(shares[0]) == pytest.approx(1.0)
    assert all(0.02 < weight <= max(of) == of[0] for of in shares for weight in of)
    with_air = sum(weight for one, weight in predictor.shares() if one.process_noise.lift > 0)
    assert with_air == pytest.approx(predictor.air, abs=0.05) and predictor.air > 0.9


def test_an_observation_may_bring_its_own_covariance_and_a_lead_that_lasts_is_not_believed() -> None:
    t_s, truth = fly_up(np.concatenate([START, REAL]), 0.3, 2.0)
    along = truth[:, 3:6] / np.linalg.norm(truth[:, 3:6], axis=1, keepdims=True)
    ps = truth[:, :3] + 0.005 * along
    sigmas = []
    for ahead_m in (0.0, 0.005):
        predictor = FilterPredictor(FilterConfig(ahead_m=ahead_m, adapt_points=0))
        for t, p in zip(t_s, ps, strict=True):
            predictor.add(round(1e6 * t), p, np.diag([1e-6, 1e-6, 1e-6]))
        off = predictor.state[:3] - truth[-1, :3]
        sigmas.append(np.sqrt(off @ np.linalg.solve(predictor.covariance[:3, :3], off)))
    assert sigmas[0] > 5, "taken for the truth"
    assert sigmas[1] < 2


def test_a_flight_is_as_likely_as_its_points_from_the_eighth_on() -> None:
    t_s, truth = fly_up(np.concatenate([START, REAL]), 0.05)
    noise = 1e-6 * np.eye(3)
    config = FilterConfig(adapt_points=0)
    begun = [
        BallFilter(config, 0, truth[0, :3], noise, needs_tick=needs_tick, odds=0.25) for needs_tick in (False, True)
    ]
    assert [one.log_odds for one in begun] == [np.log(0.25)] * 2
    assert begun[0].process_noise == ProcessNoise(
        LIFT * config.magnus, config.air_noise, config.bounce_noise_mps, 0.0, 0.15
    )
    assert begun[1].process_noise[1:3] == (config.restless_air, config.restless_bounce_mps)
    one, gained = begun[0], []
    for t, p in zip(t_s[1:], truth[1:, :3], strict=True):
        state, cov = one.state.copy(), one.covariance.copy()
        move(state, cov, round(1e6 * t) * 1e-6 - one.t_us * 1e-6, one.process_noise)
        S, miss = cov[:3, :3] + noise, p - state[:3]
        before = one.log_odds
        one.take(round(1e6 * t), PointObservation(p, noise))
        gained.append(one.log_odds - before)
        if len(gained) >= TYPICAL:
            likelihood = -0.5 * (miss @ np.linalg.solve(S, miss) + np.log(np.linalg.det(S)))
            assert gained[-1] == pytest.approx(likelihood, abs=1e-6)
    assert not any(gained[: TYPICAL - 1]) and all(gained[TYPICAL - 1 :])


def test_points_that_do_not_fit_are_counted_until_one_does() -> None:
    _, truth = fly_up(np.concatenate([START, REAL]), 0.03)
    one = BallFilter(FilterConfig(), 0, truth[0, :3], 1e-6 * np.eye(3), needs_tick=False, odds=1.0)
    strays = []
    for k in range(1, 30):
        p = truth[k, :3] + (0.5 if k in (20, 21, 22, 25) else 0.0)
        one.take(1000 * k, PointObservation(p, 1e-6 * np.eye(3)))
        strays.append(one.strays)
    assert strays[18:] == [0, 1, 2, 3, 0, 0, 1, 0, 0, 0, 0]


def test_the_scale_of_the_noise_begins_with_what_was_said_and_is_bounded() -> None:
    one = BallFilter(FilterConfig(adapt_points=8), 0, np.zeros(3), np.eye(3), needs_tick=False, odds=1.0)
    np.testing.assert_array_equal(one.noise_scales, 1.0)
    one._tally[:] = [[24.0, -8.0, 1e9], [8.0, 0.0, 0.0]]
    np.testing.assert_allclose(one.noise_scales, [(8 + 24) / 16, 0.01, 100.0])


def test_the_first_spread_is_what_the_configuration_says() -> None:
    config = FilterConfig(ahead_m=0.003)
    noise = np.array([[2e-6, 1e-6, 0.0], [1e-6, 3e-6, 0.0], [0.0, 0.0, 4e-6]])
    one = BallFilter(config, 0, np.array([1.0, 2.0, 3.0]), noise, needs_tick=False, odds=1.0)
    np.testing.assert_allclose(one.covariance[:3, :3], noise + 9e-6 * np.eye(3))
    sigmas = [10.0] * 3 + [config.spin_sigma_radps] * 3
    sigmas += [config.drag_sigma, config.restitution_sigma, config.friction_sigma, config.table_sigma_m, 0.003]
    rest = one.covariance[3:, 3:]
    np.testing.assert_allclose(rest, np.diag(np.square(sigmas)))
    expected = [1.0, 2.0, 3.0, -4.0, 0, 0, 0, 0, 0, config.drag, config.restitution, config.friction, 0.0, 0.0]
    np.testing.assert_array_equal(one.state, expected)


def test_a_bias_of_all_points_widens_what_is_predicted_and_moves_nothing() -> None:
    t_s = np.arange(0, 200) * 1e-3
    ps = path(np.concatenate([START, REAL]), t_s)[:, :3]
    sure, doubtful = (feed(FilterPredictor(FilterConfig(bias_m=bias)), t_s, ps).predict() for bias in (0.0, 0.005))
    assert sure is not None and doubtful is not None
    for a, b in ((sure.landing, doubtful.landing), (sure.hit_plane, doubtful.hit_plane)):
        assert a is not None and b is not None
        np.testing.assert_array_equal(a.p_world_m, b.p_world_m)
        np.testing.assert_allclose(b.sigma_m**2 - a.sigma_m**2, 0.005**2, rtol=1e-6)
    assert doubtful.hit_plane is not None and sure.hit_plane is not None
    later = doubtful.hit_plane.sigma_t_s**2 - sure.hit_plane.sigma_t_s**2
    assert later == pytest.approx((0.005 / abs(sure.hit_plane.v_world_mps[0])) ** 2, rel=0.2)


def test_strays_are_left_out_and_a_ball_elsewhere_begins_anew() -> None:
    t_s = np.arange(0, 200) * 1e-3
    truth = path(np.concatenate([START, REAL]), t_s)[:, :3]
    clean, stray = FilterPredictor(), FilterPredictor()
    for k, (t, p) in enumerate(zip(t_s, truth, strict=True)):
        clean.add(round(1e6 * t), p)
        stray.add(round(1e6 * t), p + (0.5 if k in (80, 120) else 0.0))
    np.testing.assert_allclose(stray.state[:3], clean.state[:3], atol=1e-4)
    for k in range(10):
        stray.add(200_000 + 1000 * k, [1.0, 0.5, 0.4])
    np.testing.assert_allclose(stray.state[:3], [1.0, 0.5, 0.4], atol=0.01)
    assert stray.stage == "pre"


def test_nothing_is_said_before_enough_was_seen_and_wrong_points_are_refused() -> None:
    predictor = FilterPredictor(filter_for("paper"))
    assert predictor.predict() is None
    assert predictor.add(0, [1.0, 0.0, 0.3]) is None
    with pytest.raises(ConfigError, match="not in order"):
        predictor.add(0, [1.0, 0.0, 0.3])
    with pytest.raises(ConfigError, match="not a position"):
        predictor.add(1000, [1.0, 0.0, np.nan])


def test_a_crossing_at_the_hitting_plane_is_the_predicted_hit_and_others_lie_on_the_path() -> None:
    t_s, states = fly_up(np.concatenate([START, REAL]), 0.16, 4.0)
    found = feed(FilterPredictor(filter_for("real")), t_s, states[:, :3]).latest
    assert found is not None and found.hit_plane is not None
    before, at_plane, behind, never = found.crossings([-1.2, -1.42, -1.7, -30.0])
    assert before is not None and at_plane is not None and behind is not None and never is None
    assert at_plane.t_s == pytest.approx(found.hit_plane.t_s, abs=1e-9)
    np.testing.assert_allclose(at_plane.p_world_m, found.hit_plane.p_world_m, atol=1e-9)
    np.testing.assert_allclose(at_plane.spin_radps, found.hit_plane.spin_radps, atol=1e-9)
    for one in (before, behind):
        np.testing.assert_allclose(found.positions(one.t_s)[0][0], one.p_world_m, atol=1e-4)
    assert before.t_s < at_plane.t_s < behind.t_s
    assert found.crossings([1.3])[0] is None, "it was there before"
