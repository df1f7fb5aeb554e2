"""The last ball that was missed before a moment: a camera showed it and its detector did not see it, or it did not
come back.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.history.rally_history import Outcome, RallyHistory, RallyStep
from core.physics.episode import Case
from core.recordings import Recording
from core.trajectory.prediction import HitPlane

LOOK_BACK_US: Final = 20_000_000
"""Length of the history that a live rally keeps."""
UNSEEN_US: Final = 10_000
"""Shortest gap that counts as missed: over a shorter one the track continues."""
AWAY_M: Final = 0.05
"""Distance of the racket from where it was sent that costs a ball (choice): two thirds of a racket's radius."""
GAP_US: Final = 5_000
"""Largest gap between consecutive windows of one camera."""
BALL_US: Final = 1_500_000
"""Duration of a ball where a recording does not state its end."""


@dataclass(frozen=True, slots=True)
class MissedBall:
    """A missed ball: camera and time."""

    t_us: int
    """End of a window that shows it."""
    camera: str
    kind: Literal["not seen", "not returned"]
    unseen_us: int = 0
    """Length of the gap in that camera; 0 if it was seen."""
    skipped_us: int = 0
    """Time of the flight that the chain did not get: its machine was busy, and skipped blocks."""
    away_m: float = 0.0
    """Distance of the racket from where it was sent when it was to hit, if above `AWAY_M`."""


@dataclass(frozen=True, slots=True, eq=False)
class MissedBallRequest:
    """Request to search a rally up to a time."""

    recording: Recording
    history: RallyHistory
    t_us: int

    @property
    def key(self) -> Hashable:
        """Cache key: equal for requests with the same answer."""
        known_us = min(self.history.followed_us, self.t_us)
        return self.recording, self.history, self.t_us, known_us, self.history.outcome_count


def find_missed_ball(request: MissedBallRequest) -> MissedBall | None:
    """The last one up to `t_us`; None if none was missed in the 20 s before it.

    Whether a ball was in the picture is known from the truth of a camera; what has none is not said to be unseen.
    """
    t_us, history = request.t_us, request.history
    steps = history.steps_between(t_us - LOOK_BACK_US, t_us)
    if not steps:
        return None
    start_us = steps[0].t_us
    unseen = _unseen(request.recording, steps)
    last = unseen[-1] if unseen else None
    outcomes = history.outcomes_between(start_us - 1, t_us)
    lost = [one for one in outcomes if one.counted and one.spot.case != Case.RETURNED]
    # The newest failure first; an unseen ball after it is newer still, and counts instead.
    for outcome in reversed(lost):
        end_us = outcome.t_us if outcome.t_us > outcome.serve_us else outcome.serve_us + BALL_US
        if last is not None and last.t_us > end_us:
            break
        during = [one for one in unseen if outcome.serve_us <= one.t_us <= end_us]
        hit_us = _hit_us(history.predicted_hits(), outcome, end_us)
        late = _skipped_us(steps, outcome.serve_us, hit_us), _away_m(history, hit_us)
        if during:
            worst = max(during, key=lambda one: one.unseen_us)
            return MissedBall(worst.t_us, worst.camera, "not returned", worst.unseen_us, *late)
        if hit_us <= t_us:
            inside = [step for step in steps if outcome.serve_us <= step.t_us <= hit_us]
            camera = min(request.recording.cameras, key=lambda name: sum(name in step.circles for step in inside))
            return MissedBall(hit_us, camera, "not returned", 0, *late)
    return last


def _skipped_us(steps: Sequence[RallyStep], start_us: int, end_us: int) -> int:
    """Sum of the gaps between the steps of a flight."""
    gaps_us = np.diff(np.array([step.t_us for step in steps if start_us <= step.t_us <= end_us], np.int64))
    return int(gaps_us[gaps_us > GAP_US].sum())


def _away_m(history: RallyHistory, hit_us: int) -> float:
    """How far the racket was from where it was sent, if both are known and that is far; else 0."""
    picture = history.at(hit_us, {}).picture
    if picture.racket is None or picture.racket_target is None:
        return 0.0
    away_m = float(np.linalg.norm(picture.racket.p_world_m - picture.racket_target.p_world_m))
    return away_m if away_m > AWAY_M else 0.0


def _unseen(recording: Recording, steps: Sequence[RallyStep]) -> list[MissedBall]:
    """Intervals in which a camera missed a ball in its picture, with the times of their middles."""
    ends_us = np.array([step.t_us for step in steps], np.int64)
    window_us = int(np.median(np.diff(ends_us))) if len(ends_us) > 1 else 0
    found = []
    for name, stream in recording.cameras.items():
        truth = stream.truth
        if truth is None or not len(truth.t_us):
            continue
        there = truth.at(ends_us).visible & truth.at(ends_us - window_us).visible
        seen = np.array([name in step.circles for step in steps], np.bool_)
        for first, last in _stretches(ends_us, there & ~seen):
            length_us = int(ends_us[last] - ends_us[first]) + window_us
            if length_us >= UNSEEN_US:
                found.append(MissedBall(int(ends_us[(first + last) // 2]), name, "not seen", length_us))
    return sorted(found, key=lambda one: one.t_us)


def _stretches(t_us: NDArray[np.int64], holds: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last rows of runs without a gap in which it is true."""
    rows = np.flatnonzero(holds)
    if not len(rows):
        return []
    broken = (np.diff(rows) > 1) | (np.diff(t_us[rows]) > GAP_US)
    firsts = rows[np.concatenate([[True], broken])]
    lasts = rows[np.concatenate([broken, [True]])]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


def _hit_us(predicted: Sequence[tuple[int, HitPlane]], outcome: Outcome, end_us: int) -> int:
    """Last predicted hit time of the ball; its end if nothing was predicted."""
    during = [hit for t_us, hit in predicted if outcome.serve_us <= t_us <= end_us]
    return min(end_us, round(during[-1].t_s * 1e6)) if during else end_us
