"""What every predictor does, whatever it knows of the flight."""

import numpy as np
import pytest

from core.errors import ConfigError
from core.table import BALL_RADIUS_M, GRAVITY_MPS2
from core.trajectory import FilterPredictor, PaperPredictor, PaperPredictorConfig, Predictor, filter_for

pytestmark = pytest.mark.numeric
FRICTION, RESTITUTION = 0.15, 0.90
START, VELOCITY = np.array([1.2, 0.1, 0.35]), np.array([-5.0, 0.3, 0.6])


def flight(t_s: np.ndarray) -> tuple[np.ndarray, float]:
    """A ball without air and spin that bounces as in the physics `paper`; and when."""
    fall_s = (VELOCITY[2] + np.sqrt(VELOCITY[2] ** 2 + 2 * GRAVITY_MPS2 * (START[2] - BALL_RADIUS_M))) / GRAVITY_MPS2
    down = VELOCITY - [0, 0, GRAVITY_MPS2 * fall_s]
    slower = 1 + FRICTION * (1 + RESTITUTION) * down[2] / np.hypot(*down[:2])
    place = START + VELOCITY * fall_s - [0, 0, GRAVITY_MPS2 * fall_s**2 / 2]
    after = t_s >= fall_s
    dt = np.where(after, t_s - fall_s, t_s)[:, None]
    p, v = (
        np.where(after[:, None], place, START),
        np.where(after[:, None], down * [slower, slower, -RESTITUTION], VELOCITY),
    )
    return p + v * dt - [0, 0, GRAVITY_MPS2 / 2] * dt**2, float(fall_s)


@pytest.fixture(params=["filter", "paper", "fit"])
def predictor(request) -> Predictor:
    if request.param == "filter":
        return FilterPredictor(filter_for("paper", sigma_point_m=0.001))
    if request.param == "paper":
        return PaperPredictor(PaperPredictorConfig(friction=FRICTION))
    return PaperPredictor(PaperPredictorConfig(friction=FRICTION, observations=12, spacing_ms=4.0))


def test_it_predicts_bounce_and_plane_before_and_after_the_bounce(predictor: Predictor) -> None:
    t_s = np.arange(0.0, 0.65, 0.002)
    ps, bounced_s = flight(t_s)
    cross = int(np.argmax(ps[:, 0] < -1.42))
    stages = []
    for t, p in zip(t_s[: cross - 5], ps, strict=False):
        new = predictor.add(round(1e6 * t), p, 1e-6 * np.eye(3))
        assert new is None or new is predictor.latest
        if new is not None and t > 0.2:
            assert new.t_us == round(1e6 * t) and new.hit_plane is not None and new.stage == new.hit_plane.stage
            np.testing.assert_allclose(new.hit_plane.p_world_m, ps[cross], atol=0.03)
            assert new.hit_plane.t_s == pytest.approx(t_s[cross], abs=0.006)
            now, later = new.positions([t, t_s[cross]])[1]
            assert (new.hit_plane.sigma_m[1:] > 0).all() and (now < later + 1e-9).all()
            stages.append(new.stage)
        if new is not None and new.stage == "pre" and t > 0.2:
            assert new.bounces and new.bounces[0].t_s == pytest.approx(bounced_s, abs=0.003)
            assert new.landing is not None and new.landing.t_s == new.bounces[0].t_s
    assert stages == sorted(stages, reverse=True) and set(stages) == {"pre", "post"}
    assert len(predictor.bounces_us) == 1
    assert predictor.bounces_us[0] * 1e-6 == pytest.approx(bounced_s, abs=0.003)


@pytest.mark.parametrize("forget", ["forget_flight", "reset"])
def test_a_flight_that_is_forgotten_leaves_no_trace(predictor: Predictor, forget: str) -> None:
    t_s = np.arange(0.0, 0.45, 0.002)
    ps, _ = flight(t_s)
    first = [predictor.add(round(1e6 * t), p) for t, p in zip(t_s, ps, strict=True)]
    getattr(predictor, forget)()
    assert predictor.latest is None and predictor.bounces_us == ()
    again = [predictor.add(round(1e6 * t), p) for t, p in zip(t_s, ps, strict=True)]
    assert [one is None for one in first] == [one is None for one in again]
    for one, other in zip(first, again, strict=True):
        if one is not None and other is not None and one.hit_plane is not None and other.hit_plane is not None:
            np.testing.assert_array_equal(one.hit_plane.p_world_m, other.hit_plane.p_world_m)


@pytest.mark.parametrize(("t_us", "p"), [(0, [1.0, 0, 0.3]), (-5, [1.0, 0, 0.3]), (9, [1.0, 0]), (9, [1.0, 0, np.inf])])
def test_what_is_no_next_point_is_refused_and_changes_nothing(predictor: Predictor, t_us: int, p: list[float]) -> None:
    given = np.array([1.0, 0.0, 0.3])
    given.flags.writeable = False
    predictor.add(0, given)
    with pytest.raises(ConfigError, match="not"):
        predictor.add(t_us, p)
    predictor.add(10, given)
