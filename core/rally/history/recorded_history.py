"""What a recording itself says of a rally, as its history."""

from __future__ import annotations

from typing import Final

import numpy as np

from core.physics.episode import Case
from core.rally.history.rally_history import Outcome, RallyHistory
from core.rally.history.rally_picture import LandingSpot
from core.rally.history.recorded_rally import EPISODES, RACKET, HasRows, read_targets
from core.recordings import BallTruth

KNOWN_CASES: Final = frozenset(int(case) for case in Case)
"""Of a row with another nothing can be said."""


def add_known(history: RallyHistory, ball: BallTruth | None, rows: HasRows) -> None:
    """The true ball, the racket, where it was sent, and what came of the balls."""
    if ball is not None:
        history.add_truth(ball)
    racket, episodes = rows.read_rows(RACKET), rows.read_rows(EPISODES)
    if racket is not None:
        history.add_rackets(*(np.asarray(racket[name]) for name in ("t_us", "p_world_m", "q_world_wxyz")))
    history.add_targets(read_targets(rows))
    if episodes is not None:
        columns = (np.asarray(episodes[name]) for name in ("serve_us", "speed_mps", "case", "f"))
        for serve_us, speed_mps, case, landing in zip(*columns, strict=True):
            if case not in KNOWN_CASES:
                continue
            spot = LandingSpot(float(landing[0]), float(landing[1]), Case(int(case)))
            history.add_outcome(Outcome(int(serve_us), int(serve_us), float(speed_mps), spot))
