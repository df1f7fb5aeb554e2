"""The pixel of one camera in the ball filter: gain, gate, a pixel that comes late, and an honest covariance alone."""

import numpy as np
import pytest

from core.cameras import StereoRig
from core.cameras.presets import camera_preset
from core.trajectory import FilterPredictor, PixelObservation
from core.trajectory.ball_kernel import AHEAD, LIFT, STATE, fly_and_bounce, glide
from core.trajectory.filter_config import PROCESS_NOISE_KINDS, UNKNOWN, refined_filter
from core.trajectory.observation import observe_pixel

pytestmark = pytest.mark.numeric
CAMERAS = camera_preset("corners")
RIG = StereoRig(CAMERAS)
ARRAYS = {name: RIG.camera_arrays(name) for name in CAMERAS}
NAMES = tuple(CAMERAS)
START = np.array([0.9, 0.1, 0.3, -6.0, 0.3, 0.5, 0, 0, 0, 0.0, 0.9, 0.15, 0.0, 0.0])
SIGMA_PX = 0.2
NOISE = SIGMA_PX**2 * np.eye(2)
GATE = 25.0


def spread() -> np.ndarray:
    """Of an estimate known to 2 mm and .1 m/s."""
    return np.diag([2e-3] * 3 + [0.1] * 3 + [1.0] * 3 + [1e-3] * 4 + [3e-4]) ** 2


def expected_pixel(x: np.ndarray, late_s: float = 0.0) -> np.ndarray:
    then = x.copy()
    glide(x, -late_s, 0.0, then)
    velocity = then[3:6]
    return CAMERAS["near_left"].project((then[:3] + then[AHEAD] * velocity / np.linalg.norm(velocity))[None])[0]


@pytest.mark.parametrize("late_s", [0.0, 0.004])
def test_the_update_is_that_of_a_kalman_filter_with_the_slopes_of_the_projection(late_s: float) -> None:
    x, cov = START.copy(), spread()
    H = np.zeros((2, STATE))
    for k in [*range(6), AHEAD]:
        step = np.zeros(STATE)
        step[k] = 1e-5
        H[:, k] = (expected_pixel(x + step, late_s) - expected_pixel(x - step, late_s)) / 2e-5
    uv = expected_pixel(x, late_s) + np.array([0.8, -0.5])
    S = H @ cov @ H.T + NOISE
    miss = uv - expected_pixel(x, late_s)
    gain = cov @ H.T @ np.linalg.inv(S)
    wanted = START + gain @ miss, cov - gain @ H @ cov
    distance, likelihood = observe_pixel(x, cov, uv, NOISE, ARRAYS["near_left"], late_s, 0.0, GATE)
    assert distance == pytest.approx(miss @ np.linalg.solve(S, miss), rel=1e-4)
    assert likelihood == pytest.approx(-0.5 * (distance + np.log(np.linalg.det(S))), rel=1e-4)
    np.testing.assert_allclose(x, wanted[0], atol=2e-6)
    np.testing.assert_allclose(cov, wanted[1], atol=1e-6)
    np.testing.assert_array_equal(cov, cov.T)
    assert np.linalg.eigvalsh(cov).min() > -1e-12


def test_a_pixel_beyond_the_gate_and_a_ball_behind_the_camera_change_nothing() -> None:
    for x, away_px in ((START.copy(), 40.0), (START + np.eye(STATE)[0] * -9.0, 0.0)):
        before, cov = x.copy(), spread()
        uv = expected_pixel(START) + away_px
        distance, _ = observe_pixel(x, cov, uv, NOISE, ARRAYS["near_left"], 0.0, 0.0, GATE)
        assert distance > GATE
        np.testing.assert_array_equal(x, before)
        np.testing.assert_array_equal(cov, spread())


def seen_pixel(name: str, p: np.ndarray, rng: np.random.Generator) -> PixelObservation:
    return PixelObservation(CAMERAS[name].project(p[None])[0] + rng.normal(0, SIGMA_PX, 2), NOISE, ARRAYS[name], GATE)


def see_by_all(predictor: FilterPredictor, t_us: int, p: np.ndarray, rng: np.random.Generator) -> None:
    uvs = np.array([camera.project(p[None])[0] for camera in CAMERAS.values()]) + rng.normal(0, SIGMA_PX, (4, 2))
    found = RIG.triangulate_one(uvs, np.broadcast_to(NOISE, (4, 2, 2)))
    if found is not None:
        predictor.add(t_us, found.p_world_m, found.covariance_m2)


def flight(seed: int, bounces: bool) -> tuple[np.ndarray, np.ndarray, bool]:
    """(100, 3) errors and (100, 3, 3) covariances of the position, each millisecond that one camera sees alone,
    and whether a bounce was noticed.

    The ball, its air and its table are drawn from what the filter believes before it sees anything.
    """
    rng, config = np.random.default_rng(seed), refined_filter()
    kind = PROCESS_NOISE_KINDS[rng.choice(3, p=[one.share for one in PROCESS_NOISE_KINDS])]
    air = rng.random() < config.air_probability
    noise = config.air_noise if kind.air is None or not air else kind.air
    scatter = config.bounce_noise_mps if kind.bounce_mps is None or not air else kind.bounce_mps
    height, up = ((0.16, 0.22), (-1.0, -0.5)) if bounces else ((0.25, 0.4), (0.0, 1.5))
    x = np.array(
        [
            *(rng.uniform(0.9, 1.2), rng.uniform(-0.3, 0.3), rng.uniform(*height)),
            *(-rng.uniform(4, 8), rng.uniform(-0.4, 0.4), rng.uniform(*up)),
            *(air * rng.normal(0, UNKNOWN["spin_sigma_radps"], 3)),
            air * max(0.0, rng.normal(UNKNOWN["drag"], UNKNOWN["drag_sigma"])),
            rng.normal(UNKNOWN["restitution"], UNKNOWN["restitution_sigma"]),
            *(max(0.02, rng.normal(UNKNOWN["friction"], UNKNOWN["friction_sigma"])), 0.0, 0.0),
        ]
    )
    predictor, alone = FilterPredictor(config), NAMES[seed % 4]
    lead, keep = rng.normal(0, config.ahead_m), np.exp(-1e-3 / config.ahead_s)
    errors, covariances = [], []
    for k in range(1, 181):
        falling = x[5] < 0
        fly_and_bounce(x, 1e-3, air * LIFT * UNKNOWN["magnus"])
        x[3:6] += rng.normal(0, scatter if falling and x[5] > 0 else noise * np.sqrt(1e-3), 3)
        lead = keep * lead + np.sqrt(1 - keep**2) * rng.normal(0, config.ahead_m)
        p = x[:3] + lead * x[3:6] / np.linalg.norm(x[3:6])
        if k <= 80:
            see_by_all(predictor, 1000 * k, p, rng)
            continue
        predictor.add_pixel(1000 * k, seen_pixel(alone, p, rng))
        found = predictor.position()
        assert found is not None
        errors.append(found.p_world_m - x[:3])
        covariances.append(found.covariance_m2)
    return np.array(errors), np.array(covariances), bool(predictor.bounces_us)


@pytest.mark.parametrize("bounces", [False, True])
@pytest.mark.gate
def test_the_covariance_is_honest_while_one_camera_carries_a_flight_for_100_ms(bounces: bool) -> None:
    flights = [flight(seed, bounces) for seed in range(60)]
    errors = np.array([one[0] for one in flights])
    covariances = np.array([one[1] for one in flights])
    nes = np.einsum("fti,ftij,ftj->ft", errors, np.linalg.inv(covariances), errors) / 3
    assert 0.8 < nes.mean() < 1.25
    assert (np.array([one[2] for one in flights]) == bounces).mean() > 0.9
    sigmas = np.sqrt(np.median(np.trace(covariances, axis1=2, axis2=3), axis=0))
    assert 2 * sigmas[10] < sigmas[50] < sigmas[99], "the growth of the error is stated"


def test_one_camera_bounds_the_error_across_its_ray() -> None:
    """Alone it leaves the distance open, and keeps what it sees as good as its pixels."""
    alone = {}
    for sees in (True, False):
        rng, x, predictor = np.random.default_rng(3), START.copy(), FilterPredictor(refined_filter())
        for k in range(1, 121):
            fly_and_bounce(x, 1e-3, 0.0)
            if k <= 30:
                see_by_all(predictor, 1000 * k, x[:3], rng)
            elif sees:
                assert predictor.add_pixel(1000 * k, seen_pixel("far_left", x[:3], rng))
            elif k == 120:
                predictor.add_pixel(1000 * k, PixelObservation(np.zeros(2), NOISE, ARRAYS["far_left"], GATE))
        found = predictor.position()
        assert found is not None
        camera = CAMERAS["far_left"].T_world_camera[:3, :3]
        alone[sees] = np.sqrt(np.diag(camera.T @ found.covariance_m2 @ camera))
    assert alone[True][:2].max() < 0.4e-3 < alone[False][:2].min()
    assert alone[True][2] > 3 * alone[True][:2].max()


def test_a_pixel_is_taken_late_but_not_too_late_nor_across_a_bounce_nor_before_a_flight() -> None:
    rng, x, predictor = np.random.default_rng(1), START.copy(), FilterPredictor(refined_filter())
    path, k = {}, 0
    while k < 60:
        k += 1
        fly_and_bounce(x, 1e-3, 0.0)
        path[k] = x[:3].copy()
        if k == 2:
            assert not predictor.add_pixel(1000 * k, seen_pixel("near_left", x[:3], rng)), "two points are no flight"
        see_by_all(predictor, 1000 * k, x[:3], rng)
        if k == 60:
            before = predictor.covariance.copy()
            assert not predictor.add_pixel(53_000, seen_pixel("near_left", path[53], rng), max_late_us=6000)
            assert not predictor.add_pixel(56_000, seen_pixel("near_left", path[60], rng), max_late_us=6000)
            np.testing.assert_array_equal(predictor.covariance, before)
            assert predictor.add_pixel(56_000, seen_pixel("near_left", path[56], rng), max_late_us=6000)
            assert predictor.covariance.trace() < before.trace() and predictor.newest_us == 60_000
    while not predictor.bounces_us:
        k += 1
        fly_and_bounce(x, 1e-3, 0.0)
        path[k] = x[:3].copy()
        see_by_all(predictor, 1000 * k, x[:3], rng)
    early = predictor.bounces_us[-1] // 1000 - 1
    assert not predictor.add_pixel(1000 * early, seen_pixel("near_left", path[early], rng), max_late_us=50_000)
