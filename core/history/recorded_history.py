"""Rally history from the data of a recording."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.history.rally_history import Outcome, RallyHistory
from core.history.rally_picture import LandingSpot
from core.history.recorded_rally import EPISODES, RACKET, HasRows, read_targets
from core.physics.episode import Case
from core.recordings import BallTruth

AT_SPOT_M: Final = 0.05
NEVER_US: Final = 2**62
KNOWN_CASES: Final = frozenset(int(case) for case in Case)
"""Outcomes that are known; a row with another value is skipped."""


def add_known(history: RallyHistory, ball: BallTruth | None, rows: HasRows) -> None:
    """Add the recorded truth, racket, targets and outcomes."""
    if ball is not None:
        history.add_truth(ball)
    racket, episodes = rows.read_rows(RACKET), rows.read_rows(EPISODES)
    if racket is not None:
        history.add_rackets(*(np.asarray(racket[name]) for name in ("t_us", "p_world_m", "q_world_wxyz")))
    history.add_targets(read_targets(rows))
    if episodes is not None:
        columns = (np.asarray(episodes[name]) for name in ("serve_us", "speed_mps", "case", "f"))
        rows_of = list(zip(*columns, strict=True))
        ends_us = [*(int(row[0]) for row in rows_of[1:]), NEVER_US]
        for (serve_us, speed_mps, case, landing), until_us in zip(rows_of, ends_us, strict=True):
            if case not in KNOWN_CASES:
                continue
            spot = LandingSpot(float(landing[0]), float(landing[1]), Case(int(case)))
            known_us = _known_us(ball, int(serve_us), until_us, np.asarray(landing, np.float64))
            history.add_outcome(Outcome(known_us, int(serve_us), float(speed_mps), spot))


def _known_us(ball: BallTruth | None, serve_us: int, until_us: int, landing: NDArray[np.float64]) -> int:
    """When it was seen what came of a ball, which rows of episodes do not say.

    It is when the true ball is at its landing spot; where it never is, when it is gone; without a true ball, its serve.
    """
    if ball is None:
        return serve_us
    rows = (ball.t_us >= serve_us) & (ball.t_us < until_us) & np.isfinite(ball.p_world_m).all(axis=1)
    if not rows.any():
        return serve_us
    with np.errstate(over="ignore"):  # a damaged one may be absurdly far away
        t_us, away_m = ball.t_us[rows], np.linalg.norm(ball.p_world_m[rows] - landing, axis=1)
    nearest = int(np.argmin(np.nan_to_num(away_m, nan=np.inf)))
    return int(t_us[nearest] if away_m[nearest] < AT_SPOT_M else t_us[-1])
