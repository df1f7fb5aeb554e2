"""Outcome classifier: from the chain's points, the outcome of every ball."""

from __future__ import annotations

import dataclasses
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import ChainState
from core.chain.control.controller import RacketDecision
from core.outcomes.ball_log import BallLog, BallPoints, ServeSeen, see_serve, stopped_at, turned, went_past
from core.outcomes.config import OutcomeClassifierConfig
from core.outcomes.stroke import ClassifiedStroke, judge_stroke, missed_stroke, stopped_stroke
from core.physics.episode import Case
from core.trajectory.prediction import HitPlane

Array = NDArray[np.float64]

AGAIN_US: Final = 20_000
"""Shortest time between two classifications of a ball."""
SERVE_POINTS: Final = 6
"""Points of a new flight by which a serve is told. Chosen by hand; not measured."""
SERVE_MPS: Final = 1.5
"""A new flight whose first points come so fast towards the robot is the next serve (choice: no rebound does)."""
SEEN_PAST: Final = 0.99
NOT_SEEN_AGAIN: Final = 0.7
"""Probability that a ball was missed that went past, or was not seen to come back (choice)."""
FELL_DOWN: Final = 0.9
"""Probability that a ball that fell between racket and table touched the table's end (choice)."""
AFTER: Final = 3
"""Points after the contact that are needed before they count."""


class OutcomeClassifier:
    """Classifies one ball after the other. Not thread-safe."""

    def __init__(self, config: OutcomeClassifierConfig | None = None, *, hit_x_m: float = -1.42) -> None:
        self.config = config or OutcomeClassifierConfig()
        self._hit_x_m = hit_x_m
        self._log = BallLog()
        self.reset()

    def reset(self) -> None:
        """Forget the ball, and expect a serve."""
        self._log.clear()
        self._phase: Literal["waiting", "flying", "decided"] = "waiting"
        self._begin_ball()

    def begin(self) -> None:
        """Announce a serve: the next ball is it. Without this, serves are detected when they are seen."""
        self._log.clear()
        self._phase = "flying"
        self._begin_ball()

    def _begin_ball(self) -> None:
        self.serve: ServeSeen | None = None
        self.newest: ClassifiedStroke | None = None
        """Newest classification of the ball in flight, or of the last one."""
        self._turn_s: float | None = None
        self._again_us = 0
        self._expected_us: float | None = None
        self._met_x_m = self._hit_x_m
        self._new_flight = 0

    @property
    def has_points(self) -> bool:
        """Whether the ball was seen at all."""
        return len(self._log) > 0

    def step(self, state: ChainState, met: RacketDecision | HitPlane | None = None) -> ClassifiedStroke | None:
        """Final classification of a ball, once, at the step that decides it; else None. `met`: where the ball is to be
        met, or the decision that sends the racket there; None: at the hitting plane.
        """
        if isinstance(met, HitPlane):
            self._expected_us, self._met_x_m = 1e6 * met.t_s, float(met.p_world_m[0])
        elif met is not None and np.isfinite(met.state[0]):
            self._expected_us, self._met_x_m = 1e6 * met.target.t_s, float(met.state[0])
        elif state.prediction is not None and state.prediction.hit_plane is not None:
            self._expected_us = 1e6 * state.prediction.hit_plane.t_s
        point, verdict = state.point, state.verdict
        if point is None:
            return self.look(state.t_us)
        return self.add(point.t_us, point.p_world_m, point.covariance_m2, is_new_flight=verdict == "new flight")

    def add(
        self, t_us: int, p_world_m: Array, covariance_m2: Array, *, is_new_flight: bool = False
    ) -> ClassifiedStroke | None:
        """Add a point, in order of time.

        Args:
            t_us: time of the point.
            p_world_m: (3,) position.
            covariance_m2: (3, 3) of the position.
            is_new_flight: whether the tracker began anew with it.
        """
        if is_new_flight:
            self._new_flight = 0
            if self._phase != "flying":
                self._log.clear()
        if not self._log.add(t_us, p_world_m, covariance_m2):
            return self.look(t_us)
        self._new_flight += 1
        before = None
        if self._new_flight == SERVE_POINTS and self._is_serve():
            before = self._next_serve(t_us)
        if self._phase == "flying":
            if self.serve is None:
                self.serve = see_serve(self._log.points())
            if self._turn_s is None:
                self._turn_s = turned(self._log.points(), self.config)
        return before or self.look(t_us)

    def look(self, now_us: int) -> ClassifiedStroke | None:
        """Final classification, if the time that has passed decides it."""
        if self._phase != "flying" or not len(self._log):
            return None
        points = self._log.points()
        found = self._missed(points, now_us) if self._turn_s is None else self._struck(points, now_us)
        return self._finish(found) if found is not None and found.final else None

    def _is_serve(self) -> bool:
        points = self._log.points()
        x, t = points.ps_m[-SERVE_POINTS:, 0], points.t_s[-SERVE_POINTS:]
        return x[-1] > self.config.reach_x_m and (x[-1] - x[0]) / (t[-1] - t[0]) < -SERVE_MPS

    def _next_serve(self, t_us: int) -> ClassifiedStroke | None:
        """Start with the next ball; the previous one is classified now if it was not yet."""
        if self._phase == "flying" and len(self._log) == SERVE_POINTS:
            return None  # it is the ball that was announced
        before = self._as_it_is(t_us) if self._phase == "flying" else None
        self._log.keep_last(SERVE_POINTS)
        self._phase = "flying"
        self._begin_ball()
        self._new_flight = SERVE_POINTS
        return before

    def _as_it_is(self, t_us: int) -> ClassifiedStroke:
        if self._turn_s is not None:
            points = self._log.points()
            found = judge_stroke(points.part(slice(0, len(points) - SERVE_POINTS)), self._turn_s, self.config)
            if found is not None:
                return dataclasses.replace(found, serve=self.serve, final=True)
        return dataclasses.replace(missed_stroke(t_us, NOT_SEEN_AGAIN), serve=self.serve)

    def _finish(self, found: ClassifiedStroke) -> ClassifiedStroke:
        found = dataclasses.replace(found, serve=self.serve)
        self.newest, self._phase = found, "decided"
        return found

    def _missed(self, points: BallPoints, now_us: int) -> ClassifiedStroke | None:
        if went_past(points, self.config, self._met_x_m):
            # A stroke shows within some points; one that was behind the racket is over.
            return missed_stroke(now_us, SEEN_PAST)
        stopped = stopped_at(points, self.config, self._met_x_m)
        if stopped is not None:
            return stopped_stroke(now_us, stopped, FELL_DOWN)
        last_us = self._log.last_us or now_us
        lost_us = 1000 * self.config.lost_ms
        late = self._expected_us is None or now_us - self._expected_us > lost_us
        return missed_stroke(now_us, NOT_SEEN_AGAIN) if now_us - last_us > lost_us and late else None

    def _struck(self, points: BallPoints, now_us: int) -> ClassifiedStroke | None:
        if now_us < self._again_us or self._turn_s is None:
            return None
        self._again_us = now_us + AGAIN_US
        found = judge_stroke(points, self._turn_s, self.config)
        last_us = self._log.last_us or now_us
        if found is None:
            lost = now_us - last_us > 1000 * self.config.lost_ms
            return missed_stroke(now_us, NOT_SEEN_AGAIN) if lost else None
        decided_us = found.landing_us if found.case is Case.OUT else found.contact_us
        settled_us = decided_us + 1000 * self.config.settle_ms
        seen_after = int((points.t_s > (decided_us - points.start_us) * 1e-6).sum())
        is_sure = found.probability >= self.config.sure and now_us >= settled_us and seen_after >= AFTER
        out_of_patience = now_us >= found.contact_us + 1000 * self.config.patience_ms
        lost = now_us - last_us > 1000 * self.config.lost_ms and now_us >= decided_us
        self.newest = dataclasses.replace(found, t_us=now_us, final=is_sure or out_of_patience or lost)
        # Nothing can be said before the ball is there: do not ask at every point until then.
        self._again_us = max(self._again_us, round(min(settled_us, now_us + 100_000.0)))
        return self.newest
