import numpy as np
import pytest

from core.errors import ConfigError
from core.physics import TaskConfig
from core.simulation.episodes import draw_serves, fly_serves
from core.simulation.episodes.closed_form import sample_serves
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory import PaperPredictor, PaperPredictorConfig, Prediction, predict_arrivals, predictor_for
from core.trajectory.continuation import one_sigma_moves

pytestmark = pytest.mark.numeric
LAUNCH = np.array([1.5, 0.2, 0.35])
VELOCITY = np.array([-5.0, -0.1, 0.6])


def ideal_flight(t_s: np.ndarray, e: float = 0.9, k: float = 0.82) -> tuple[np.ndarray, float, np.ndarray]:
    """Positions of a ball that the table reflects exactly as the predictor assumes, when it bounces, velocity after."""
    bounce_s = (VELOCITY[2] + np.sqrt(VELOCITY[2] ** 2 + 2 * GRAVITY_MPS2 * (LAUNCH[2] - BALL_RADIUS_M))) / GRAVITY_MPS2
    g = np.array([0, 0, -GRAVITY_MPS2])

    def arc(p: np.ndarray, v: np.ndarray, dt: np.ndarray) -> np.ndarray:
        return p + v * dt[:, None] + 0.5 * g * dt[:, None] ** 2

    at_bounce = arc(LAUNCH, VELOCITY, np.array([bounce_s]))[0]
    after = (VELOCITY + g * bounce_s) * [k, k, -e]
    ps = np.where((t_s < bounce_s)[:, None], arc(LAUNCH, VELOCITY, t_s), arc(at_bounce, after, t_s - bounce_s))
    return ps, bounce_s, after


def feed(predictor: PaperPredictor, t_us: np.ndarray, ps: np.ndarray) -> list[Prediction]:
    return [found for t, p in zip(t_us, ps, strict=True) if (found := predictor.add(int(t), p)) is not None]


@pytest.fixture(params=[1000, 2000, 5000, 10_000], ids=lambda step: f"{step} us")
def t_us(request) -> np.ndarray:
    return np.arange(0, 650_000, request.param)


def test_an_ideal_flight_is_predicted_exactly_from_the_fifth_observation_on(t_us) -> None:
    ps, bounce_s, after = ideal_flight(t_us * 1e-6)
    found = feed(PaperPredictor(), t_us, ps)
    assert found[0].t_us == 40_000 and found[0].stage == "pre"
    hit_s = bounce_s + (-1.42 - (LAUNCH[0] + VELOCITY[0] * bounce_s)) / after[0]
    p_hit = ideal_flight(np.array([hit_s]))[0][0]
    v_hit = after - [0, 0, GRAVITY_MPS2 * (hit_s - bounce_s)]
    mixed = bounce_s + 0.02  # the bounce is noticed a few milliseconds late
    for prediction in found:
        if prediction.t_us * 1e-6 <= bounce_s or prediction.t_us * 1e-6 > mixed:
            plane = prediction.hit_plane
            assert plane is not None
            np.testing.assert_allclose(plane.p_world_m, p_hit, atol=1e-9)
            np.testing.assert_allclose(plane.v_world_mps, v_hit, atol=1e-9)
            assert plane.t_s == pytest.approx(hit_s, abs=1e-9)
            assert plane.stage == prediction.stage
    first_post = next(prediction for prediction in found if prediction.stage == "post")
    assert bounce_s + 0.04 < first_post.t_us * 1e-6 < bounce_s + 0.065, "five new observations"


def test_the_bounce_and_the_curve_are_on_the_true_path(t_us) -> None:
    ps, bounce_s, _ = ideal_flight(t_us * 1e-6)
    first = feed(PaperPredictor(), t_us[:60], ps[:60])[0]
    bounce = first.bounces[0]
    assert bounce.t_s == pytest.approx(bounce_s, abs=1e-9)
    assert bounce.p_world_m[2] == pytest.approx(BALL_RADIUS_M)
    assert first.landing is not None and first.landing.t_s == bounce.t_s
    np.testing.assert_allclose(first.curve_ps_world_m, ideal_flight(first.curve_t_s)[0], atol=1e-9)
    assert first.curve_t_s[0] == 0.04 and first.hit_plane is not None
    assert first.curve_t_s[-1] == pytest.approx(first.hit_plane.t_s)


def test_nothing_later_is_used() -> None:
    rng = np.random.default_rng(0)
    t_us = np.arange(0, 600_000, 2000)
    ps = ideal_flight(t_us * 1e-6)[0] + rng.normal(0, 0.003, (len(t_us), 3))
    whole = feed(PaperPredictor(), t_us, ps)
    assert len(whole) > 30
    for cut in (60, 150, 230, 250):
        changed = ps.copy()
        changed[cut:] += 1.0
        part = [found for found in feed(PaperPredictor(), t_us, changed) if found.t_us < t_us[cut]]
        same = [found for found in whole if found.t_us < t_us[cut]]
        assert [found.t_us for found in part] == [found.t_us for found in same]
        for one, other in zip(part, same, strict=True):
            assert one.hit_plane is not None and other.hit_plane is not None
            np.testing.assert_array_equal(one.hit_plane.p_world_m, other.hit_plane.p_world_m)


@pytest.mark.parametrize("speed_mps", [3.0, 5.0, 7.0, 9.0])
def test_every_serve_s_bounce_is_seen_and_after_it_gravity_is_exact(speed_mps: float) -> None:
    task = TaskConfig()
    serves = draw_serves(speed_mps, 15, task, np.random.default_rng(3))
    arrivals = fly_serves(serves, task)
    for number in range(len(serves)):
        t_us = np.arange(0, int(1e6 * arrivals.t_s[number]), 2000)
        ps = sample_serves(
            serves[number : number + 1],
            fly_serves(serves[number : number + 1], task),
            t_us[None].astype(np.float64) * 1e-6,
            task,
        )
        predictor = PaperPredictor()
        post = [found for found in feed(predictor, t_us, ps[0]) if found.stage == "post"]
        assert len(predictor.bounces_us) == 1
        assert abs(predictor.bounces_us[0] * 1e-6 - arrivals.bounce_t_s[number]) <= 0.002
        assert post, "even the fastest ball is predicted before it arrives"
        assert post[0].hit_plane is not None
        np.testing.assert_allclose(post[0].hit_plane.p_world_m, arrivals.states[number, :3], atol=1e-6)
        np.testing.assert_allclose(post[0].hit_plane.v_world_mps, arrivals.states[number, 3:6], atol=1e-6)


def test_noise_makes_no_bounce_in_the_air_and_hides_none_on_the_table() -> None:
    rng = np.random.default_rng(5)
    t_us = np.arange(0, 600_000, 2000)
    ps, bounce_s, _ = ideal_flight(t_us * 1e-6)
    for _ in range(40):
        predictor = PaperPredictor()
        feed(predictor, t_us, ps + rng.normal(0, 0.003, ps.shape))
        assert len(predictor.bounces_us) == 1
        assert abs(predictor.bounces_us[0] * 1e-6 - bounce_s) < 0.006


def test_a_lowest_point_high_above_the_table_is_no_bounce() -> None:
    t_us = np.arange(0, 600_000, 2000)
    predictor = PaperPredictor()
    feed(predictor, t_us, ideal_flight(t_us * 1e-6)[0] + [0, 0, 0.3])
    assert predictor.bounces_us == () and predictor.stage == "pre"


def test_the_uncertainties_are_those_of_many_noisy_flights() -> None:
    config = PaperPredictorConfig(sigma_point_m=0.002, restitution_sigma=0.0, tangential_sigma=0.0)
    rng = np.random.default_rng(6)
    t_us = np.arange(0, 41_000, 10_000)
    ps = ideal_flight(t_us * 1e-6)[0]
    later_s = np.array([0.2, 0.5])
    claimed = feed(PaperPredictor(config), t_us, ps)[0]
    assert claimed.hit_plane is not None
    hits, times, positions = [], [], []
    for _ in range(800):
        found = feed(PaperPredictor(config), t_us, ps + rng.normal(0, 0.002, ps.shape))[0]
        assert found.hit_plane is not None
        hits.append([*found.hit_plane.p_world_m, *found.hit_plane.v_world_mps])
        times.append(found.hit_plane.t_s)
        positions.append(found.positions(later_s)[0])
    plane = claimed.hit_plane
    np.testing.assert_allclose(plane.sigma_m[1:], np.std(hits, axis=0)[1:3], rtol=0.12)
    np.testing.assert_allclose(plane.sigma_mps, np.std(hits, axis=0)[3:], rtol=0.12)
    assert plane.sigma_m[0] == 0 and plane.sigma_t_s == pytest.approx(np.std(times), rel=0.12)
    np.testing.assert_allclose(claimed.positions(later_s)[1], np.std(positions, axis=0), rtol=0.12)
    np.testing.assert_allclose(np.sqrt(np.diag(plane.covariance)), [*plane.sigma_m, *plane.sigma_mps])


def test_a_ball_that_flies_away_has_no_hitting_plane_but_a_landing() -> None:
    t_us = np.arange(0, 60_000, 10_000)
    ps, _, _ = ideal_flight(t_us * 1e-6)
    ps[:, 0] *= -1
    found = feed(PaperPredictor(), t_us, ps)[-1]
    assert found.hit_plane is None and found.landing is not None and len(found.bounces) >= 1


def test_points_out_of_order_or_not_finite_are_refused() -> None:
    predictor = PaperPredictor()
    predictor.add(1000, LAUNCH)
    with pytest.raises(ConfigError, match="after 1000"):
        predictor.add(1000, LAUNCH)
    with pytest.raises(ConfigError, match="3 finite"):
        predictor.add(2000, [0.0, np.nan, 0.0])
    predictor.forget_flight()
    assert predictor.add(0, LAUNCH) is None and predictor.latest is None


def test_a_real_table_is_less_certain_than_the_published_one() -> None:
    paper, real = predictor_for("paper"), predictor_for("real", hit_x_m=-1.5)
    assert paper == PaperPredictorConfig() and real.hit_x_m == -1.5
    assert real.restitution_sigma > paper.restitution_sigma and real.tangential_sigma > paper.tangential_sigma


def test_many_flights_at_once_give_what_one_by_one_gives() -> None:
    task = TaskConfig()
    serves = draw_serves(4.0, 30, task, np.random.default_rng(9))
    arrivals = fly_serves(serves, task)
    config = predictor_for("paper")
    t_s = np.tile(np.arange(5).astype(np.float64) * 0.01, (30, 1))
    ps = sample_serves(serves, arrivals, t_s, task)
    constants = (config.hit_x_m, config.restitution, config.tangential_factor)
    states, t_c = predict_arrivals(
        t_s, ps, hit_x_m=constants[0], restitution=constants[1], tangential_factor=constants[2]
    )
    for number in range(30):
        single = feed(PaperPredictor(config), (t_s[number] * 1e6).round(), ps[number])[0].hit_plane
        assert single is not None
        np.testing.assert_allclose(states[number], [*single.p_world_m, *single.v_world_mps], atol=1e-9)
        assert t_c[number] == pytest.approx(single.t_s)
    after_s = arrivals.bounce_t_s[:, None] + 0.002 + np.arange(5) * 0.01
    observed = np.ones((30, 5), bool)
    observed[:, 3:] = False
    observed[0, 1:] = False
    states, t_c = predict_arrivals(
        after_s,
        sample_serves(serves, arrivals, after_s, task),
        observed,
        hit_x_m=-1.42,
        restitution=0.9,
        tangential_factor=0.8,
    )
    assert np.isnan(t_c[0]) and np.isnan(states[0]).all(), "one point is no flight"
    np.testing.assert_allclose(states[1:], arrivals.observations[1:], atol=1e-9)
    np.testing.assert_allclose(t_c[1:], arrivals.t_s[1:], atol=1e-9)


def test_no_point_after_the_expected_bounce_is_taken_for_one_before_it(t_us) -> None:
    """Until the ball has risen again nothing tells; a fit across the bounce would be centimetres wrong."""
    ps, bounce_s, after = ideal_flight(t_us * 1e-6)
    for prediction in feed(PaperPredictor(), t_us, ps):
        assert prediction.stage == "post" or prediction.t_us * 1e-6 <= bounce_s
    mixed = feed(PaperPredictor(PaperPredictorConfig(bounce_wait_ms=0.0)), t_us, ps)
    late = [one for one in mixed if one.stage == "pre" and one.t_us * 1e-6 > bounce_s]
    if t_us[1] < 10_000:
        assert late, "without the wait there are such predictions"
    for prediction in late:
        assert prediction.hit_plane is not None
        assert np.abs(prediction.hit_plane.v_world_mps[2] - after[2]) > 0.1


def test_a_wrong_expectation_of_a_bounce_is_given_up_after_a_while() -> None:
    """A ball that goes on along the table: no bounce comes, and predictions go on."""
    t_us = np.arange(0, 480_000, 2000)
    z = np.maximum(0.35 - GRAVITY_MPS2 / 2 * (1e-6 * t_us) ** 2, BALL_RADIUS_M)
    found = feed(PaperPredictor(), t_us, np.column_stack([1.2 - 5e-6 * t_us, 0 * t_us, z]))
    gaps_us = np.diff([prediction.t_us for prediction in found])
    assert 40_000 <= gaps_us.max() <= 60_000
    assert found[-1].t_us > 310_000


@pytest.mark.parametrize("speed_mps", [3.0, 5.0, 7.0, 9.0])
def test_with_friction_the_flight_off_the_table_is_that_of_the_simulated_table(speed_mps) -> None:
    """Spinless serves, seen before the bounce only: p_c within millimetres where one factor misses by centimetres."""
    task = TaskConfig()
    serves = draw_serves(speed_mps, 5, task, np.random.default_rng(3))
    arrivals = fly_serves(serves, task)
    for number in range(5):
        start_us = int(1e6 * (arrivals.bounce_t_s[number] - 0.06))
        t_us = np.arange(start_us, start_us + 50_001, 10_000)
        rows = np.array([[*sample_serves(serves, arrivals, np.tile(t * 1e-6, (5, 1)), task)[number, 0]] for t in t_us])
        found = feed(PaperPredictor(PaperPredictorConfig(friction=0.15)), t_us, rows)[0].hit_plane
        assert found is not None and found.stage == "pre"
        truth = arrivals.states[number]
        np.testing.assert_allclose(found.p_world_m, truth[:3], atol=0.002)
        np.testing.assert_allclose(found.v_world_mps, truth[3:6], atol=0.01)
        assert found.t_s == pytest.approx(arrivals.t_s[number], abs=0.001)


def test_points_that_waited_for_the_bounce_to_be_noticed_may_complete_a_prediction_at_once() -> None:
    t_us = np.arange(0, 400_000, 1000)
    ps, bounce_s, _ = ideal_flight(t_us * 1e-6)
    predictor = PaperPredictor(PaperPredictorConfig(spacing_ms=5.0, bounce_rise_m=0.08))
    for t, p in zip(t_us, ps, strict=True):
        found = predictor.add(int(t), p)
        if predictor.bounces_us:
            break
    assert t > 1e6 * bounce_s + 25_000, "a rise of 8 cm takes as long as five observations"
    assert found is not None and found is predictor.latest
    assert (found.stage, found.t_us) == ("post", t)


def test_the_order_of_points_is_kept_where_a_bounce_leaves_none_of_them() -> None:
    t_us = np.arange(0, 400_000, 5000)
    ps, bounce_s, _ = ideal_flight(t_us * 1e-6)
    predictor = PaperPredictor(PaperPredictorConfig(bounce_guard_ms=30.0))
    for t, p in zip(t_us, ps, strict=True):
        predictor.add(int(t), p)
        if predictor.bounces_us:
            break
    assert 0 < t - 1e6 * bounce_s < 30_000, "noticed while it is guarded: no point is left"
    with pytest.raises(ConfigError, match="not in order"):
        predictor.add(int(t), p)
    predictor.add(int(t) + 5000, p)


def test_what_a_sigma_moves_is_half_the_way_between_its_neighbours_or_all_of_the_way_to_the_one_that_there_is() -> None:
    values = np.array([10.0, 13.0, 9.0, np.nan, 8.5, 10.5, np.nan, np.nan, np.nan, 7.0, 7.0])
    np.testing.assert_allclose(one_sigma_moves(values), [2.0, 1.5, 0.5, 0.0, 0.0])
    pairs = np.column_stack([values, -values])
    np.testing.assert_allclose(one_sigma_moves(pairs)[:, 1], [-2.0, -1.5, -0.5, 0.0, 0.0])
