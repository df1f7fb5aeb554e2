"""Four cameras on one ball: flights, and the ball in a camera that only the others have it in."""

from __future__ import annotations

import numpy as np
import pytest

from core.cameras import ball_circles
from core.cameras.presets import camera_preset
from labels.arrays import label_arrays
from labels.assist import Proposals, ball_in_space, fit_flight, reproject, whole_flight
from labels.assist.flight import FittedFlight
from labels.assist.stereo import BallInSpace, Position, median_over_cameras
from labels.model import Label, LabelState

pytestmark = pytest.mark.numeric
RIG = camera_preset("corners")
NAMES = tuple(RIG)
CAMERAS = tuple(RIG.values())
STEP_US = 2_000
FLIGHT = FittedFlight(0, 300_000, np.array([0.7, 0.2, 0.25, -4.5, -0.3, 1.3, 0.112, 0.0, 0.0, 0.0]), 0.0)
TIMES = np.arange(0, 300_001, STEP_US)
SIGMA_PX = 0.3


def seen(camera, t_us: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) centre and radius of the flight in a picture, the centre with noise."""
    circles = FLIGHT.seen_by(camera, t_us)
    circles[:, :2] += rng.normal(0, SIGMA_PX, (len(t_us), 2))
    return circles


def proposals_of(camera, seed: int, t_us: np.ndarray = TIMES) -> Proposals:
    x, y, r = seen(camera, t_us, np.random.default_rng(seed)).T
    return Proposals(t_us, x, y, r, np.zeros((len(t_us), 3)), STEP_US, "made up")


def labels_of(camera, seed: int, t_us: np.ndarray):
    rows = seen(camera, t_us, np.random.default_rng(seed))
    return label_arrays(
        Label(t_us=int(t), state=LabelState.VISIBLE, x_px=x, y_px=y, r_px=r)
        for t, (x, y, r) in zip(t_us, rows.tolist(), strict=True)
    )


def test_a_flight_that_no_two_cameras_see_whole_is_fitted_from_all() -> None:
    parts = (TIMES[:60:5], TIMES[:60:5], TIMES[80::5], TIMES[80::5])
    labels = [labels_of(camera, seed, t) for seed, (camera, t) in enumerate(zip(CAMERAS, parts, strict=True))]
    flight = fit_flight(CAMERAS, labels)
    assert flight is not None and flight.residual_px < 2 * SIGMA_PX
    assert np.linalg.norm(flight.at(TIMES) - FLIGHT.at(TIMES), axis=1).max() < 0.004
    assert fit_flight(CAMERAS, [labels[0], labels_of(CAMERAS[1], 0, TIMES[:0]), labels[2], labels[3]]) is not None
    assert fit_flight(CAMERAS[:1], labels[:1]) is None


def test_a_whole_flight_is_taken_though_one_of_four_found_a_person_all_the_time() -> None:
    proposals = [proposals_of(camera, seed) for seed, camera in enumerate(CAMERAS)]
    walks = 400.0 + 0.2 * np.arange(len(TIMES))
    for wrong in range(4):
        given = list(proposals)
        given[wrong] = Proposals(
            TIMES, walks, walks / 2, np.full(len(TIMES), 9.0), np.zeros((len(TIMES), 3)), STEP_US, ""
        )
        found = whole_flight(CAMERAS, given, 150_000)
        assert found is not None and (found.start_us, found.end_us) == (TIMES[0], TIMES[-1])
        assert min(len(part) for row, part in enumerate(found.agreed) if row != wrong) > len(TIMES) - 3
        assert len(found.agreed[wrong]) < 5 and len(found.doubted[wrong]) > len(TIMES) - 5
        assert np.linalg.norm(found.flight.at(TIMES) - FLIGHT.at(TIMES), axis=1).max() < 0.002


def test_a_camera_without_proposals_is_no_reason_to_find_no_flight() -> None:
    proposals = [proposals_of(camera, seed) for seed, camera in enumerate(CAMERAS)]
    nothing = proposals[0].between(0, 0)
    for blind in range(4):
        given = [nothing if row == blind else part for row, part in enumerate(proposals)]
        found = whole_flight(CAMERAS, given, 150_000)
        assert found is not None and len(found.agreed[blind]) == 0 and len(found.agreed[blind - 1]) > 140
    assert whole_flight(CAMERAS, [proposals[0], nothing, nothing, nothing], 150_000) is None


def positions_at(p_m: np.ndarray, rng: np.random.Generator, sigma_px: float) -> dict[str, Position]:
    found = {}
    for name, camera in RIG.items():
        circle = ball_circles(camera, p_m)
        x, y = np.array([circle.u_px[0], circle.v_px[0]]) + rng.normal(0, sigma_px, 2)
        found[name] = Position(x_px=x, y_px=y, covariance_px2=(sigma_px**2, 0.0, sigma_px**2))
    return found


def test_one_of_four_that_is_elsewhere_is_left_out_and_its_distance_is_known() -> None:
    p_m = np.array([-0.4, 0.1, 0.3])
    for name in NAMES:
        positions = positions_at(p_m, np.random.default_rng(1), 0.1)
        wrong = positions[name]
        positions[name] = Position(x_px=wrong.x_px + 30.0, y_px=wrong.y_px - 40.0)
        ball = ball_in_space(RIG, positions)
        assert ball is not None and set(ball.cameras) == set(NAMES) - {name}
        assert ball.off_px[name] == pytest.approx(50.0, abs=1.0) and ball.residual_px < 0.5
        assert np.linalg.norm(ball.p_world_m - p_m) < 0.001
    assert ball_in_space(RIG, {NAMES[0]: positions[NAMES[0]]}) is None


def test_the_ball_of_two_lies_in_a_thirds_picture_within_two_sigmas_as_often_as_it_should() -> None:
    """Two sigmas of two coordinates hold 86 of 100."""
    rng, p_m, inside, count = np.random.default_rng(3), np.array([-0.5, 0.2, 0.25]), 0, 400
    target = RIG[NAMES[3]]
    circle = ball_circles(target, p_m)
    for _ in range(count):
        positions = positions_at(p_m, rng, 1.0)
        ball = ball_in_space(RIG, {name: positions[name] for name in NAMES[:2]})
        assert ball is not None
        seen_there = reproject(ball, target)
        assert seen_there is not None and seen_there.r_px == pytest.approx(circle.r_px[0], rel=0.02)
        xx, xy, yy = seen_there.covariance_px2
        off = np.array([seen_there.x_px - circle.u_px[0], seen_there.y_px - circle.v_px[0]])
        inside += bool(off @ np.linalg.solve([[xx, xy], [xy, yy]], off) < 4.0)
    assert 0.8 < inside / count < 0.92


def test_a_ball_outside_the_picture_is_nowhere_in_it() -> None:
    for p_m, shown in (([-0.5, 0.2, 0.25], 4), ([-3.5, 0.0, 1.5], 0)):  # on the table; behind all of them
        ball = BallInSpace(np.array(p_m), 1e-6 * np.eye(3), 0.0, {}, ())
        assert sum(reproject(ball, camera) is not None for camera in CAMERAS) == shown


def test_one_of_three_others_that_contradicts_does_not_outvote_two() -> None:
    said = [np.array([0.2, 9.0, np.nan]), np.array([0.4, 8.0, np.nan]), np.array([7.0, np.nan, np.nan])]
    middle = median_over_cameras(said)
    assert middle is not None and middle[:2].tolist() == pytest.approx([0.4, 8.5]) and np.isnan(middle[2])
    assert median_over_cameras([]) is None
