"""What a live rally knows beside events, as groups of rows."""

import numpy as np

from core.history.following import add_known
from core.history.rally_history import RallyHistory
from core.history.record_live import LiveRows
from core.history.recorded_rally import RACKET
from core.live.link import messages as m
from core.physics.episode import Case


def state(end_us: int, x_m: float) -> m.WorldState:
    """A block of 10 ms in which the racket stands at x."""
    t_us = np.array([end_us - 5000, end_us], np.int64)
    pose = np.array([[x_m, 0, 0.2, 1, 0, 0, 0, 0, 0, 0]] * 2, np.float64)
    nothing = np.empty(0, np.int64)
    return m.WorldState(
        session="s", seq=1, wall_ns=0, start_us=end_us - 10_000, t_us=end_us, phase="idle", paused=False,
        speed_factor=1.0, noise_hz=0.1, auto_serve_mps=0.0, real_time_factor=1.0, served=0, returned=0,
        ball_t_us=nothing, ball=np.empty((0, 9)), ball_visible=np.empty(0, np.uint8), racket_t_us=t_us, racket=pose,
    )  # fmt: skip


def outcome(t_us: int) -> m.OutcomeNotice:
    unknown = float("nan")
    return m.OutcomeNotice(
        session="s", seq=2, t_us=t_us, serve_us=t_us - 700_000, speed_mps=5.0, case=Case.RETURNED,
        arrival=(-1.42, 0.1, 0.2, -4.0, 0.0, 0.0), q_wxyz=(1.0, 0.0, 0.0, 0.0), landing_m=(0.8, 0.1, 0.02),
        landing_v_mps=(unknown,) * 3, net_z_m=0.3,
    )  # fmt: skip


def test_rows_read_like_those_of_a_file_and_make_the_same_history() -> None:
    rows = LiveRows()
    assert rows.read_rows(RACKET) is None
    rows.add_state(state(10_000, -1.6))
    rows.add_state(state(20_000, -1.5))
    rows.add_outcome(outcome(900_000), "built-in")
    assert rows.read_rows(RACKET)["t_us"].tolist() == [5000, 10_000, 15_000, 20_000]
    history = RallyHistory()
    add_known(history, None, rows)
    assert history.at(12_000, {}).picture.racket.p_world_m[0] == -1.6
    (spot,) = history.at(1_000_000, {}).picture.spots
    assert (spot.x_m, spot.y_m, spot.case.name) == (0.8, 0.1, "RETURNED")


def test_a_new_count_begins_without_the_landing_spots_of_the_old_one() -> None:
    rows, history = LiveRows(), RallyHistory()
    rows.add_outcome(outcome(900_000), "built-in")
    add_known(history, None, rows)
    before = history.outcome_count
    history.clear_outcomes()
    moment = history.at(1_000_000, {})
    assert moment.picture.spots == () == moment.outcomes
    assert history.outcome_count > before, "so that the 3D view is drawn anew"


def test_old_rows_are_forgotten_and_a_new_session_begins_anew() -> None:
    rows = LiveRows()
    rows.add_state(state(10_000, -1.6))
    rows.add_state(state(20_000, -1.5))
    rows.forget_before(15_000)
    assert rows.read_rows(RACKET)["t_us"].tolist() == [15_000, 20_000]
    rows.clear()
    assert rows.read_rows(RACKET) is None
