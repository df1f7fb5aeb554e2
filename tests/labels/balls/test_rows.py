"""The rows of the ball index say what the truth, the predictions or the episodes of a recording say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.chain.follow import true_positions
from core.events import SensorSize
from core.recordings import BallTruth, RecordingWriter, open_recording
from labels.balls.rows import BallRow, path_of_truth, rows_of_path, rows_of_recording, rows_of_run, with_outcomes
from labels.balls.tracking import rows_of_track
from labels.contacts import contacts_of_truth

RUN = Path(__file__).parents[2] / "fixtures" / "written-by-0.1" / "runs" / "ddpg"
STEP_US = 500


def truth_of(*, second_at_us: int = 700_000) -> BallTruth:
    """A ball without air from x = +1 m at 5 m/s that bounces, is hit back at x = -1.3 m; and then a second one."""
    parts = []
    for start_us in (0, second_at_us):
        t = np.arange(0, 600_000, STEP_US) * 1e-6
        bounce_s, hit_s = 0.4, 0.46
        x = np.where(t < hit_s, 1 - 5 * t, 1 - 5 * hit_s + 4 * (t - hit_s))
        vx = np.where(t < hit_s, -5.0, 4.0)
        z = np.where(t < bounce_s, 0.02 + 4.905 * (bounce_s**2 - t**2), 0.02 + 3 * (t - bounce_s))
        vz = np.where(t < bounce_s, -9.81 * t, 3.0)
        zero = np.zeros_like(t)
        spins = np.stack([zero, np.where(t < hit_s, 30.0, 40.0), zero], 1)
        parts.append(
            (
                start_us + np.round(t * 1e6).astype(np.int64),
                np.stack([x, zero, z], 1),
                np.stack([vx, zero, vz], 1),
                spins,
            )
        )
    t_us, ps, vs, spins = (np.concatenate(column) for column in zip(*parts, strict=True))
    return BallTruth(t_us, ps, vs, spins, np.ones(len(t_us), np.bool_))


def rows_of(ball: BallTruth) -> list[BallRow]:
    return rows_of_path(path_of_truth(ball), contacts_of_truth(ball), "truth")


def test_each_ball_has_its_flights_its_bounce_and_its_stroke_in_order() -> None:
    rows = rows_of(truth_of())
    assert [(row.number, row.kind) for row in rows] == [
        (number, kind) for number in (1, 2) for kind in ("flight", "bounce", "flight", "stroke")
    ]
    flight, bounce, back, stroke = rows[:4]
    assert (flight.t_us, back.end_us) == (0, 599_500)
    assert flight.end_us == back.t_us == stroke.t_us and abs((stroke.t_us or 0) - 460_000) <= STEP_US
    assert abs((bounce.t_us or 0) - 400_000) <= STEP_US
    assert flight.speed_mps == pytest.approx(5) and stroke.speed_mps == pytest.approx(5)  # (4, 3) m/s
    assert bounce.speed_mps == pytest.approx(np.hypot(5, 9.81 * 0.4), abs=0.01)
    assert (flight.spin_radps, stroke.spin_radps, flight.spin_sigma_radps) == (30, 40, 0)
    assert flight.state == pytest.approx((1, 0, 0.02 + 4.905 * 0.16, -5, 0, 0, 0, 30, 0))
    assert stroke.state[3:] == pytest.approx((4, 0, 3, 0, 40, 0)) and stroke.state == back.state
    assert flight.net_z_m == pytest.approx(0.02 + 4.905 * (0.4**2 - 0.2**2), abs=1e-3)
    assert bounce.net_z_m == flight.net_z_m and np.isnan([stroke.net_z_m, back.net_z_m]).all()  # it ends before the net


def test_a_ball_that_follows_at_once_is_another_ball_and_no_stroke() -> None:
    apart, at_once = rows_of(truth_of()), rows_of(truth_of(second_at_us=600_000))
    assert [(row.number, row.kind) for row in at_once] == [(row.number, row.kind) for row in apart]
    assert at_once[4].t_us == 600_000


def test_a_ball_that_nobody_sees_has_no_rows() -> None:
    ball = truth_of()
    hidden = BallTruth(ball.t_us, ball.p_world_m, ball.v_world_mps, ball.spin_radps, np.zeros_like(ball.visible))
    assert rows_of(hidden) == []


def test_the_outcome_is_that_of_the_serve_before() -> None:
    episodes = {
        "serve_us": np.array([700_000, 0]),
        "case": np.array([4, 2]),
        "f": np.array([[1.0, 0.0, 0.0], [np.nan] * 3]),
        "g": np.array([[0.7, 0.4], [0.5, 0.0]]),
    }
    rows = with_outcomes(rows_of(truth_of()), episodes)
    assert [row.outcome for row in rows] == ["net"] * 4 + ["returned"] * 4
    assert np.isnan(rows[0].error_m) and rows[-1].error_m == pytest.approx(0.5)
    assert with_outcomes([BallRow(kind="flight", number=1, t_us=-5, method="m")], episodes)[0].outcome == ""


def write(path: Path, groups: dict[str, dict[str, np.ndarray]]) -> list[BallRow]:
    with RecordingWriter(path, {"left": SensorSize(32, 24)}) as writer:
        for group, rows in groups.items():
            writer.append_rows(group, rows)
        writer.extend_duration(2_000_000)
    with open_recording(path) as recording:
        return rows_of_recording(recording)


def test_without_a_true_ball_the_stored_predictions_are_taken(tmp_path: Path) -> None:
    t_us = np.array([10_000, 20_000, 30_000, 900_000, 910_000])
    v = np.array([[-3.0, 0, 4], [-3, 0, 4], [-6, 0, 8], [-1, 0, 0], [-2, 0, 0]])
    predictions = {"t_us": t_us, "t_hit_us": t_us + 400_000, "v_hit_mps": v, "stage": np.array([b"pre"] * 5)}
    predictions |= {"p_hit_m": np.zeros((5, 3)), "cov": np.zeros((5, 6, 6))}
    first, second = write(tmp_path / "a.h5", {"/predictions": predictions})
    assert (first.t_us, first.end_us, first.speed_mps, first.method) == (10_000, 430_000, 10, "prediction")
    assert (second.number, second.t_us, second.end_us, second.speed_mps) == (2, 900_000, 1_310_000, 2)
    assert np.isnan(first.spin_radps)


def test_with_episodes_alone_each_is_a_flight_and_with_nothing_there_are_none(tmp_path: Path) -> None:
    episodes = {
        "serve_us": np.array([5_000]), "speed_mps": np.array([6.0]), "case": np.array([5]),
        "f": np.full((1, 3), np.nan), "g": np.zeros((1, 2)),
    }  # fmt: skip
    (row,) = write(tmp_path / "a.h5", {"/episodes": episodes})
    assert (row.t_us, row.speed_mps, row.outcome, row.method) == (5_000, 6, "missed", "episode")
    assert write(tmp_path / "b.h5", {}) == []


def test_an_episode_of_a_run_is_a_serve_and_a_stroke() -> None:
    serve, stroke = rows_of_run(RUN, 0)[:2]
    assert (serve.kind, stroke.kind, serve.number, stroke.number) == ("flight", "stroke", 1, 1)
    assert serve.speed_mps == pytest.approx(np.hypot(2.718923, 1.267855)) and serve.spin_radps == 0
    assert (stroke.net_z_m, stroke.error_m, stroke.outcome) == (0.237159, pytest.approx(0.360430613), "returned")
    assert serve.t_us is None and serve.method == "ddpg"
    assert np.hypot(*serve.state[3:6:2]) == pytest.approx(serve.speed_mps) and np.isnan(stroke.state).all()
    assert rows_of_run(RUN, 0, lambda: True) == []


def test_the_tracker_finds_the_flight_and_the_bounce_that_the_truth_has(serve_recording: Path) -> None:
    shares: list[float] = []
    with open_recording(serve_recording) as recording:
        assert recording.ball is not None
        truth = rows_of_recording(recording)
        rows = rows_of_track(recording, progress=shares.append)
        assert rows_of_track(recording, cancelled=lambda: True) == []
        assert np.isfinite(true_positions(recording.ball, [row.t_us for row in rows])).all()
    assert [row.kind for row in rows] == [row.kind for row in truth] == ["flight", "bounce"]
    assert rows[1].t_us == pytest.approx(truth[1].t_us, abs=1_000)
    assert rows[1].speed_mps == pytest.approx(truth[1].speed_mps, rel=0.05)
    assert rows[0].net_z_m == pytest.approx(truth[0].net_z_m, abs=0.005)
    np.testing.assert_allclose(rows[0].state[:3], truth[0].state[:3], atol=0.2)
    np.testing.assert_allclose(rows[0].state[3:6], truth[0].state[3:6], atol=0.3)
    assert rows[0].spin_sigma_radps > 0 and rows[0].method == "tracker"
    assert shares == sorted(shares) and 0 <= shares[0] < 1
