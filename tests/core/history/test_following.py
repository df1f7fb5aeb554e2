"""When it was seen what came of a recorded ball: rows of episodes do not say, the true ball does."""

import numpy as np
import pytest

from core.history.following import add_known
from core.history.rally_history import RallyHistory
from core.history.recorded_rally import EPISODES
from core.physics.episode import Case
from core.recordings import BallTruth

SERVES_US = (50_000, 1_050_000)


class Rows:
    """Two balls: one lands at (0.8, 0.1), of the other nobody knows where it went."""

    def read_rows(self, group: str):
        if group != EPISODES:
            return None
        landing = np.array([[0.8, 0.1, 0.02], [np.nan] * 3])
        case = np.array([Case.RETURNED, Case.MISSED])
        return {"serve_us": np.array(SERVES_US), "speed_mps": np.array([5.0, 5.0]), "case": case, "f": landing}


def ball() -> BallTruth:
    """Straight along x at 2 m/s, past the landing spot 0.4 s after the serve, gone 0.8 s after it."""
    t_us = np.arange(0, 2_000_000, 1000)
    since_s = ((t_us - SERVES_US[0]) % 1_000_000) / 1e6
    p = np.column_stack([2.0 * since_s, np.full(len(t_us), 0.1), np.full(len(t_us), 0.02)])
    there = since_s < 0.8
    p[~there] = np.nan
    return BallTruth(t_us, p, np.zeros_like(p), np.zeros_like(p), there)


def test_a_landing_is_seen_when_the_ball_lands_and_a_lost_ball_when_it_is_gone() -> None:
    history = RallyHistory()
    add_known(history, ball(), Rows())
    spots = {t_us: len(history.at(t_us, {}).picture.spots) for t_us in (440_000, 460_000, 1_840_000, 1_860_000)}
    assert spots == {440_000: 0, 460_000: 1, 1_840_000: 1, 1_860_000: 2}


@pytest.mark.parametrize("truth", [None, BallTruth(np.empty(0, np.int64), *[np.empty((0, 3))] * 3, np.empty(0, bool))])
def test_without_a_true_ball_it_is_known_at_the_serve(truth) -> None:
    history = RallyHistory()
    add_known(history, truth, Rows())
    assert len(history.at(SERVES_US[0], {}).picture.spots) == 1
