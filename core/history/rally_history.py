"""History of a rally as processed by the chain: queried for any moment, live or recorded."""

from __future__ import annotations

import threading
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from core.chain.chain import BallPoint
from core.chain.control.controller import RacketDecision
from core.chain.control.hit_choice import HitChoice
from core.chain.control.player import PlayerState
from core.history.rally_picture import LandingSpot, Pose, RallyPicture
from core.history.shown_prediction import ShownPrediction, places_of, shown_prediction, spreads_of
from core.recordings import BallTruth
from core.trajectory import Prediction
from core.trajectory.prediction import HitPlane

Array = NDArray[np.float64]

HALF_WINDOW_US: Final = 16_000
"""A speed is the way from so long before a point to so long after it: an error of 1 mm at its ends is 0.05 m/s."""


def trail_speeds_mps(t_us: NDArray[np.int64], ps_world_m: Array) -> Array:
    """(N,) speed at each of the points (N, 3) of one flight, seen at ascending times (N,); NaN for a single point.

    It is that of the chord, so a little low over the milliseconds of a bounce.
    """
    return np.linalg.norm(trail_velocities_mps(t_us, ps_world_m), axis=1)


def trail_velocities_mps(t_us: NDArray[np.int64], ps_world_m: Array) -> Array:
    """(N, 3) the velocity of which `trail_speeds_mps` is the magnitude."""
    if len(t_us) < 2:
        return np.full((len(t_us), 3), np.nan)
    first = np.searchsorted(t_us, t_us - HALF_WINDOW_US, side="left")
    last = np.searchsorted(t_us, t_us + HALF_WINDOW_US, side="right") - 1
    alone = first == last  # gaps on both sides: use the neighbour's
    first, last = np.where(alone, np.maximum(first - 1, 0), first), np.where(alone & (first == 0), last + 1, last)
    seconds = (t_us[last] - t_us[first]) * 1e-6
    return (ps_world_m[last] - ps_world_m[first]) / seconds[:, None]


Item = TypeVar("Item")

TRAIL_US: Final = 700_000
FLIGHT_GAP_US: Final = 120_000
"""A trail ends at a gap longer than this."""
BALL_US: Final = 30_000
"""A ball unseen for this long is not drawn."""
EXPECTED_US: Final = 60_000
"""Predictions stay this long after the time at which the ball was to be hit."""
OUTCOMES_KEPT: Final = 200
"""Most outcomes kept of a live rally: more landing points would cover each other."""
RACKET_US: Final = 200_000
"""A racket's target is shown this long after its time."""
SPEED_POINTS: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class RallyStep:
    """State after one step of the chain."""

    t_us: int
    point: BallPoint | None
    circles: dict[str, tuple[float, float, float]]
    """u, v, r in pixels, by camera."""
    before: ShownPrediction | None
    """Last prediction before the bounce, of this flight."""
    after: ShownPrediction | None
    sent: RacketDecision | None
    seconds: float
    """Wall time of the step."""
    used: frozenset[str] = frozenset()
    """The cameras that tell where the ball is, at the time of its point or at one of their own."""


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """Outcome of a ball."""

    t_us: int
    serve_us: int
    speed_mps: float
    spot: LandingSpot
    counted: bool = True
    """Whether it counts, see `ReturnCounts`: a ball that nobody saw coming is no miss of the player."""


@dataclass(frozen=True, slots=True, eq=False)
class RallyMoment:
    """State of the rally at one time."""

    t_us: int
    picture: RallyPicture
    step: RallyStep | None
    sent: RacketDecision | None
    """Target of the racket at this time."""
    speed_mps: float | None
    """Speed of the ball from its last points, m/s."""
    outcomes: tuple[Outcome, ...]
    """Outcomes up to this time, oldest first."""


class _Line(Generic[Item]):
    """Items in order of time, with the oldest ones dropped now and then."""

    def __init__(self) -> None:
        self.t_us: list[int] = []
        self.items: list[Item] = []

    def add(self, t_us: int, item: Item) -> None:
        self.t_us.append(t_us)
        self.items.append(item)

    def last(self, t_us: int) -> Item | None:
        """Newest item not after a time."""
        found = bisect_right(self.t_us, t_us) - 1
        return self.items[found] if found >= 0 else None

    def between(self, start_us: int, end_us: int) -> list[Item]:
        """Items with start < t <= end."""
        return self.items[bisect_right(self.t_us, start_us) : bisect_right(self.t_us, end_us)]

    def forget_before(self, t_us: int) -> None:
        cut = bisect_left(self.t_us, t_us)
        if cut > len(self.items) // 4:  # rarely: it moves the whole list
            del self.t_us[:cut], self.items[:cut]

    def keep_newest(self, most: int) -> None:
        if len(self.items) > 2 * most:
            del self.t_us[:-most], self.items[:-most]


class RallyHistory:
    """History of one rally. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        with self._lock:
            self._steps: _Line[RallyStep] = _Line()
            self._points: _Line[BallPoint] = _Line()
            self._flights: _Line[int] = _Line()  # start time of each
            self._rackets: _Line[Pose] = _Line()
            self._truths: _Line[Array | None] = _Line()
            self._outcomes: _Line[Outcome] = _Line()
            self._outcome_count = 0
            self._targets: _Line[RacketDecision] = _Line()
            self._choices: _Line[HitChoice] = _Line()
            self._hits: _Line[tuple[int, HitPlane]] = _Line()
            self._before: ShownPrediction | None = None
            self._after: ShownPrediction | None = None

    @property
    def followed_us(self) -> int:
        """Time up to which the chain has processed."""
        with self._lock:
            return self._steps.t_us[-1] if self._steps.t_us else 0

    def predicted_hits(self) -> list[tuple[int, HitPlane]]:
        """Times and values of the predictions of where the ball is hit."""
        with self._lock:
            return list(self._hits.items)

    def steps_between(self, start_us: int, end_us: int) -> list[RallyStep]:
        """Steps of the chain with start < t <= end that are remembered."""
        with self._lock:
            return self._steps.between(start_us, end_us)

    def outcomes_between(self, start_us: int, end_us: int) -> list[Outcome]:
        """Balls whose outcome became known in start < t <= end."""
        with self._lock:
            return self._outcomes.between(start_us, end_us)

    @property
    def outcome_count(self) -> int:
        """Number of balls with a known outcome, also dropped ones."""
        return self._outcome_count

    def add_step(self, state: PlayerState) -> None:
        """The next step of the chain, and what the racket was told."""
        chain = state.chain
        circles = {
            name: (found.u_px, found.v_px, found.r_px) for name, found in chain.detections.items() if found is not None
        }
        with self._lock:
            if chain.is_new and chain.prediction is not None:
                self._expect(state, chain.prediction)
            shown = self._before, self._after
            step = RallyStep(chain.t_us, chain.point, circles, *shown, state.decision, chain.seconds.total, chain.used)
            self._steps.add(chain.t_us, step)
            if chain.point is not None:
                if chain.verdict == "new flight":
                    self._flights.add(chain.point.t_us, chain.point.t_us)
                self._points.add(chain.point.t_us, chain.point)

    def add_rackets(self, t_us: NDArray[np.int64], ps_world_m: Array, qs_wxyz: Array) -> None:
        """Add true racket poses: times (N,), positions (N, 3), orientations (N, 4)."""
        with self._lock:
            for t, p, q in zip(t_us.tolist(), ps_world_m, qs_wxyz, strict=True):
                self._rackets.add(t, Pose(p, q))

    def add_targets(self, targets: Iterable[RacketDecision]) -> None:
        """Add the recorded racket targets, which replace the chain's own decisions.

        A recording does not keep the landing that was expected, so the goal is shown in its place.
        """
        with self._lock:
            for one in targets:
                self._targets.add(one.t_us, replace(one, landing_m=one.goal_m))

    def add_choices(self, choices: Iterable[HitChoice]) -> None:
        """Add the recorded choices of where balls are hit."""
        with self._lock:
            for one in choices:
                self._choices.add(one.t_us, one)

    def add_truth(self, truth: BallTruth) -> None:
        """Add the true ball."""
        with self._lock:
            for t, p, visible in zip(truth.t_us.tolist(), truth.p_world_m, truth.visible.tolist(), strict=True):
                self._truths.add(t, p if visible and np.isfinite(p).all() else None)

    def add_outcome(self, outcome: Outcome) -> None:
        """Outcome of a ball."""
        with self._lock:
            self._outcomes.add(outcome.t_us, outcome)
            self._outcome_count += 1

    def clear_outcomes(self) -> None:
        """Forget the outcomes so far."""
        with self._lock:
            self._outcomes = _Line()
            self._outcome_count += 1

    def forget_before(self, t_us: int) -> None:
        """Bound the memory of a live rally; of its outcomes the newest stay."""
        with self._lock:
            for line in (self._steps, self._points, self._flights, self._rackets, self._truths, self._hits):
                line.forget_before(t_us)
            self._outcomes.keep_newest(OUTCOMES_KEPT)

    def at(self, t_us: int, camera_positions: dict[str, Array]) -> RallyMoment:
        """The rally at one time; rays come from the cameras' positions (3,)."""
        with self._lock:
            step = self._steps.last(t_us)
            begun_us = self._flights.last(t_us) or 0
            # Less 1: `between` leaves its start out.
            points = self._points.between(max(t_us - TRAIL_US, begun_us - 1), t_us)
            racket = self._rackets.last(t_us)
            truth = self._truths.last(t_us)
            outcomes = tuple(self._outcomes.between(-1, t_us))
            sent = self._targets.last(t_us) if self._targets.items else step.sent if step else None
        points = _one_flight(points)
        newest = points[-1] if points and t_us - points[-1].t_us <= BALL_US else None
        rays = (
            tuple((camera_positions[name], newest.p_world_m) for name in newest.uvs_px if name in camera_positions)
            if newest
            else ()
        )
        before, after = (_still(step.before, t_us), _still(step.after, t_us)) if step else (None, None)
        newest_expected = after or before
        hit = newest_expected.hit if newest_expected else None
        sent = sent if sent is not None and _near(sent, t_us) else None
        tube = newest_expected.sigmas() if newest_expected else (np.empty((0, 3)), np.empty((0, 3)))
        bounce = next((one.bounce for one in (before, after) if one is not None and one.bounce is not None), None)
        trail = np.array([point.p_world_m for point in points]).reshape(-1, 3)
        picture = RallyPicture(
            ball=None if newest is None else newest.p_world_m,
            trail=trail,
            trail_speeds_mps=trail_speeds_mps(np.array([point.t_us for point in points], np.int64), trail),
            truth=truth,
            rays=rays,
            before_bounce=before.path if before else np.empty((0, 3)),
            after_bounce=after.path if after else np.empty((0, 3)),
            tube=tube[0],
            tube_sigmas=tube[1],
            spreads=spreads_of(newest_expected.prediction) if newest_expected else (),
            bounce=bounce,
            bounce_in_s=_still_to_come(_bounce_s(newest_expected), t_us),
            hit=None if hit is None else hit.p_world_m,
            hit_in_s=_still_to_come(None if hit is None else hit.t_s, t_us),
            hit_places=places_of(newest_expected, possible=True),
            refused_places=places_of(newest_expected, possible=False),
            no_stroke=newest_expected.no_stroke if newest_expected else "",
            racket=racket,
            racket_target=Pose(sent.target.p_m, sent.target.q_wxyz) if sent else None,
            landing_target=sent.landing_m if sent else None,
            spots=tuple(outcome.spot for outcome in outcomes if outcome.counted),
        )
        return RallyMoment(t_us, picture, step, sent, _speed_mps(points) if newest else None, outcomes)

    def recorded_target(self, t_us: int) -> RacketDecision | None:
        """Where a recording says that the racket was sent, at a time; None if it does not say."""
        with self._lock:
            return self._targets.last(t_us)

    def _expect(self, state: PlayerState, predicted: Prediction) -> None:
        recorded = self._targets.last(state.chain.t_us) if self._targets.items else None
        choice = state.choice or self._recorded_choice(state.chain.t_us)
        expected = shown_prediction(predicted, recorded or state.decision, choice)
        if expected.hit is not None:
            self._hits.add(expected.t_us, (expected.t_us, expected.hit))
        if predicted.stage == "pre":
            self._before, self._after = expected, None
        else:
            self._after = expected

    def _recorded_choice(self, t_us: int) -> HitChoice | None:
        """What a recording says of the ball in flight; None if that ball has passed every place."""
        choice = self._choices.last(t_us)
        ahead = choice is not None and any(1e6 * one.hit.t_s >= t_us for one in choice.candidates)
        return choice if ahead else None


def _one_flight(points: list[BallPoint]) -> list[BallPoint]:
    """The points after the last long gap."""
    for number in range(len(points) - 1, 0, -1):
        if points[number].t_us - points[number - 1].t_us > FLIGHT_GAP_US:
            return points[number:]
    return points


def _still(expected: ShownPrediction | None, t_us: int) -> ShownPrediction | None:
    return expected if expected is not None and t_us <= expected.end_us + EXPECTED_US else None


def _bounce_s(expected: ShownPrediction | None) -> float | None:
    """When the first bounce of a prediction is expected; None after it."""
    if expected is None or expected.prediction.stage != "pre" or not expected.prediction.bounces:
        return None
    return float(expected.prediction.bounces[0].t_s)


def _still_to_come(t_s: float | None, t_us: int) -> float | None:
    left_s = None if t_s is None else t_s - t_us * 1e-6
    return left_s if left_s is not None and left_s > 0 else None


def _near(sent: RacketDecision, t_us: int) -> bool:
    return t_us <= sent.target.t_s * 1e6 + RACKET_US


def _speed_mps(points: list[BallPoint]) -> float | None:
    """Slope of a line through the last points, robust against one that is off by some millimetres."""
    last = points[-SPEED_POINTS:]
    if len(last) < 3:
        return None
    t_s = np.array([point.t_us for point in last]) * 1e-6
    ps = np.array([point.p_world_m for point in last])
    return float(np.linalg.norm(np.polyfit(t_s - t_s[0], ps, 1)[0]))
