"""The constants of flight and bounce from flights whose constants are known."""

from pathlib import Path

import numpy as np
import pytest

from core.errors import RallyscopeError
from core.metrics.flight_predictions import bounce_point, compare_models
from core.physics.config import PhysicsConfig, physics_profile
from core.physics.fit_flights import (
    RecordedFlight,
    _residuals,
    _sparsity,
    bootstrap,
    first_guess,
    fit_physics,
    fit_start,
    read_flight_file,
    simulate_flight,
    with_constants,
)

pytestmark = pytest.mark.numeric
DRAG, RESTITUTION, FRICTION, MAGNUS = 0.40, 0.88, 0.30, 0.12
TRUE = with_constants(MAGNUS, DRAG, RESTITUTION, FRICTION)
NOISE_M = 0.001


def flights(count: int, seed: int = 0) -> tuple[list[RecordedFlight], np.ndarray]:
    """Flights of 0.6 s at 180 Hz with one bounce and some spin, and their true starts."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, 0.6, 1 / 180)
    made, starts = [], []
    for number in range(count):
        start = np.array([1.2, 0, 0.3, *rng.normal((-5.0, 0, 1.0), (1.0, 0.4, 0.3)), *rng.normal(0, 100, 3)])
        ps = simulate_flight(start, t_s, TRUE) + rng.normal(0, NOISE_M, (len(t_s), 3))
        made.append(RecordedFlight(f"{number}", t_s, ps))
        starts.append(start)
    return made, np.array(starts)


def test_a_flight_bounces_where_it_comes_down() -> None:
    start = np.array([1.0, 0.0, 0.3, -5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    bounce = bounce_point(start, TRUE)
    assert bounce is not None
    when, x, y = bounce
    ps = simulate_flight(start, np.array([when - 1e-6, when, when + 0.05]), TRUE)
    np.testing.assert_allclose(ps[0], [x, y, 0.02], atol=1e-4)
    assert ps[2, 2] > 0.02, "up again"


def test_the_constants_that_made_the_flights_are_found() -> None:
    made, _ = flights(12)
    fitted = fit_physics(made, MAGNUS)
    assert fitted.drag_coefficient == pytest.approx(DRAG, abs=0.02)
    assert fitted.restitution == pytest.approx(RESTITUTION, abs=0.01)
    assert fitted.friction == pytest.approx(FRICTION, abs=0.05)
    assert fitted.median_m < 3 * NOISE_M
    assert fitted.profile().air.magnus_coefficient == MAGNUS


def test_a_guess_that_is_the_truth_stays_and_a_start_s_spin_costs_what_the_prior_says() -> None:
    """Without noise nothing pulls away from the truth but the prior on the spins, so they are none here."""
    t_s = np.arange(0.0, 0.5, 1 / 90)
    starts = np.array([[1.2, 0.0, 0.3, -5.0, 0.2, 1.0, 0, 0, 0], [1.0, 0.1, 0.3, -4.0, 0.0, 0.5, 0, 0, 0]])
    exact = [RecordedFlight(f"{k}", t_s, simulate_flight(start, t_s, TRUE)) for k, start in enumerate(starts)]
    fitted = fit_physics(exact, MAGNUS, guess=(np.array([DRAG, RESTITUTION, FRICTION]), starts))
    np.testing.assert_allclose(fitted.starts, starts, atol=1e-4)
    found = fitted.drag_coefficient, fitted.restitution, fitted.friction
    assert found == pytest.approx((DRAG, RESTITUTION, FRICTION), abs=1e-5)
    assert fitted.rms_m < 1e-6 and fitted.median_m < 1e-6


def test_the_pattern_of_the_unknowns_is_that_of_the_residuals() -> None:
    """Each unknown is moved a little: what changes must be in the pattern, and no column of it is for nothing."""
    rng = np.random.default_rng(3)
    made = [RecordedFlight("", t_s, rng.normal(0, 1, (len(t_s), 3))) for t_s in (np.arange(4) / 10, np.arange(6) / 10)]
    x = np.concatenate([[4.0, 18.0, 5.0], *([120.0, 0, 8.0, -50.0, 3.0, -20.0, 1.0, 2.0, -1.0] for _ in made)])
    x[3:] += rng.normal(0, 0.1, 18)
    pattern, here = _sparsity(made).toarray(), _residuals(x, made, MAGNUS)
    assert pattern.shape == (30 + 6, 3 + 18) and here.shape == (36,)
    for unknown in range(len(x)):
        moved = x.copy()
        moved[unknown] += 0.05
        changed = _residuals(moved, made, MAGNUS) != here
        assert changed.any() and not (changed & (pattern[:, unknown] == 0)).any(), unknown
    for flight, (rows, prior) in enumerate(((slice(0, 12), slice(30, 33)), (slice(12, 30), slice(33, 36)))):
        own = np.zeros(36, bool)
        own[rows] = own[prior] = True
        assert (pattern[~own, 3 + 9 * flight : 12 + 9 * flight] == 0).all()
    assert (pattern[30:, :3] == 0).all(), "the prior on spins is about no constant"


def test_a_spin_of_one_standard_deviation_costs_one() -> None:
    t_s = np.arange(6) / 10
    made = [RecordedFlight("", t_s, np.zeros((6, 3)))]
    x = np.concatenate([[4.0, 18.0, 5.0], [0, 0, 30, 0, 0, 0, 4.0, -8.0, 2.0]])  # in units of 50 rad/s
    assert _residuals(x, made, MAGNUS)[18:] == pytest.approx([1.0, -2.0, 0.5])


def test_the_first_guess_is_the_start_of_a_parabola() -> None:
    expected = np.array([1.0, -0.2, 0.3, -5.0, 0.4, 1.5, 0, 0, 0])
    for apart_s, used in ((0.01, 11), (0.04, 6)):  # the first tenth of a second, or six points if that is longer
        t_s = apart_s * np.arange(used + 3)
        ps = expected[:3] + np.outer(t_s, expected[3:6]) - np.outer(t_s**2, [0, 0, 9.81 / 2])
        ps[used - 1] += [0.11, 0, 0]
        early = RecordedFlight("", t_s, ps)
        assert abs(first_guess(early)[3] + 5.0) > 0.1, "the last of them counts"
        ps[used - 1] -= [0.11, 0, 0]
        ps[used:] = 9.0  # perhaps behind a bounce
        assert first_guess(RecordedFlight("", t_s, ps)) == pytest.approx(expected, abs=1e-9)


def test_one_flights_start_is_found_under_known_constants() -> None:
    made, starts = flights(3, seed=2)
    for flight, start in zip(made, starts, strict=True):
        found = fit_start(flight, TRUE, with_spin=True)
        assert np.linalg.norm(found[:3] - start[:3]) < 0.003
        assert np.linalg.norm(found[3:6] - start[3:6]) < 0.05
        assert fit_start(flight, TRUE, with_spin=False)[6:].tolist() == [0, 0, 0]


def test_the_true_model_predicts_better_than_gravity_alone() -> None:
    made, _ = flights(8, seed=4)
    found = compare_models(made, fit_physics(made, MAGNUS))
    gravity, both = found["gravity"], found["drag + Magnus"]
    assert both.ahead_median_mm[0.2] < 0.5 * gravity.ahead_median_mm[0.2]
    assert both.bounce_median_mm < gravity.bounce_median_mm
    assert gravity.flights == {0.1: 8, 0.2: 8, 0.3: 8}


def test_the_spread_is_that_of_the_choice_of_flights() -> None:
    made, _ = flights(6, seed=6)
    shares: list[float] = []
    spread = bootstrap(made, fit_physics(made, MAGNUS), 3, 0, shares.append)
    assert shares == pytest.approx([1 / 3, 2 / 3, 1])
    assert 0 < spread.drag_coefficient < 0.05 and 0 < spread.restitution < 0.05 and spread.samples == 3


def test_foreign_flights_are_turned_into_the_world_frame(tmp_path) -> None:
    rows = "\n".join(f"{10 + k / 180},{0.1},{-1.0 + 0.02 * k},{0.3}" for k in range(20))
    path = tmp_path / "one.csv"
    path.write_text(f"Timestamp,X,Y,Z\n{rows}\n")
    flight = read_flight_file(path)[0]
    assert flight.t_s[0] == 0 and flight.name == "one"
    np.testing.assert_allclose(flight.ps_m[0], [1.0, 0.1, 0.3])  # along y before, so along x, turned to fly to -x
    assert flight.ps_m[-1, 0] < flight.ps_m[0, 0]


def test_a_flight_in_our_world_frame_is_taken_as_it_is_and_twelve_points_are_enough(tmp_path) -> None:
    rows = [f"{3 + k / 100},{0.5 + 0.02 * k},-0.1,0.3" for k in range(12)]
    path = tmp_path / "ours.csv"
    path.write_text("t_s,x_m,y_m,z_m\n" + "\n".join(rows))
    flight = read_flight_file(path)[0]
    np.testing.assert_allclose(flight.t_s, np.arange(12) / 100)
    np.testing.assert_allclose(flight.ps_m[:, 0], 0.5 + 0.02 * np.arange(12))
    np.testing.assert_allclose(flight.ps_m[:, 1:], np.tile([-0.1, 0.3], (12, 1)))
    path.write_text("t_s,x_m,y_m,z_m\n" + "\n".join(rows[:11]))
    with pytest.raises(RallyscopeError, match="too short"):
        read_flight_file(path)[0]


@pytest.mark.parametrize(
    "text",
    ["", "Timestamp,X,Y,Z\n", "Timestamp,X,Y,Z\n1,2,3\n", "Timestamp,X,Y,Z\n" + "1,2,3,4\n" * 20, "t_s,x_m\n1,2\n"],
)
def test_what_is_no_flight_is_refused(text: str, tmp_path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(RallyscopeError, match=r"bad\.csv"):
        read_flight_file(path)[0]


def test_the_profile_real_explains_recorded_flights_better_than_the_textbook(shared_data: Path) -> None:
    recorded = [
        read_flight_file(path)[0] for path in sorted((shared_data / "trajectories" / "tt3d").glob("*.csv"))[:16]
    ]

    def median_mm(physics: PhysicsConfig) -> float:
        off = []
        for flight in recorded:
            start = fit_start(flight, physics, with_spin=True)
            ps = simulate_flight(start, flight.t_s, physics)
            off.append(1e3 * np.median(np.linalg.norm(ps - flight.ps_m, axis=1)))
        return float(np.median(off))

    textbook = with_constants(magnus=0.10, drag=0.47, restitution=0.90, friction=0.25)
    assert median_mm(physics_profile("real")) < min(6.0, median_mm(textbook))
