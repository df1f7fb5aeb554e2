"""Where along its flight a ball is hit: the place with the best chance to return it, within what the racket can do.

Candidates are the crossings of planes a few centimetres apart, before, at and behind the paper's: the ball rises there,
is at its top, or falls. Each is judged by the rules (after one bounce, before the second), by the racket's reach, speed
and time, and by the chance that the best stroke returns the ball, given how well the ball will be known by then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.config import check_settings, setting
from core.simulation.episodes.racket import RacketConfig
from core.table import BALL_RADIUS_M, TABLE_LENGTH_M, TABLE_WIDTH_M
from core.trajectory.prediction import HitPlane, Stage, TablePoint

Array = NDArray[np.float64]
PAPER_X_M: Final = -1.42
"""The paper's plane is one of the candidates."""


NO_BOUNCE: Final = "it does not bounce on the table"
NOT_YET: Final = "it has not bounced there"
TOO_SOON: Final = "too soon after the bounce to be seen"
TWICE: Final = "it bounces a second time before"
BELOW: Final = "below the table's top"
TOO_LOW: Final = "too low: the face would touch the table"
NO_STROKE: Final = "no stroke brings it over the net and onto the table"
OUT_OF_REACH: Final = "out of the racket's reach"
WAY_OUT: Final = "the way there leaves the robot's box"
TILTED: Final = "the face would be tilted more than the robot allows"
TOO_SLOW: Final = "the racket is too slow for the way there"
NO_TIME: Final = "the racket cannot be there in time"
ROUNDING_M: Final = 1e-9
REASONS: Final = (
    NOT_YET, NO_BOUNCE, TOO_SOON, TWICE, BELOW, TOO_LOW, NO_STROKE, OUT_OF_REACH, TILTED, WAY_OUT, NO_TIME, TOO_SLOW,
)  # fmt: skip
"""Why a ball cannot be hit somewhere, from what nothing can change to what nearly was a stroke."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HitChoiceConfig:
    """Settings of the choice."""

    nearest_x_m: float = setting(-1.00, -1.36, -0.2)
    """Candidate farthest over the table (choice: the racket does not reach farther from its place with a swing)."""
    farthest_x_m: float = setting(-1.82, -3.0, -1.42)
    """Candidate farthest behind the table (choice)."""
    step_m: float = setting(0.06, 0.01, 0.5)
    """Distance of two candidates (choice)."""
    face_radius_m: float = setting(0.08, 0.02, 0.5)
    """Radius of the racket's face."""
    table_gap_m: float = setting(0.01, 0.0, 0.2)
    """Over the table the rim of the face stays so far above it (choice)."""
    lowest_m: float = setting(0.03, -0.5, 0.5)
    """A ball behind the table is hit above this height: from below it touches the table's end (choice)."""
    see_ms: float = setting(42.0, 0.0, 300.0)
    """A ball is hit so long after its bounce: that is noticed after 8 ms, 20 ms are the way from light to the racket,
    12 ms the last ones in which nothing is decided, and two are for points (choice)."""
    point_sigma_m: float = setting(0.001, 1e-5, 0.1)
    """Standard deviation of a point, for how well the ball will be known (our measurement: 0.5 to 2 mm)."""
    rate_hz: float = setting(500.0, 10.0, 10_000.0)
    """Points a second."""
    enough: float = setting(0.01, 0.0, 0.5)
    """Candidates whose chance is this near to the best are as good; of those the landing's accuracy decides ..."""
    alike: float = setting(0.25, 0.0, 10.0)
    """... and of those whose landing is known this share worse than best, the one nearest to the paper's plane (choice:
    the racket waits there; our measurement: the difference does not show in where balls land)."""
    switch_gain: float = setting(0.10, 0.0, 1.0)
    """The racket goes elsewhere only for so much more chance: a new place costs the motion so far (choice)."""
    reserve: float = setting(0.1, 0.0, 0.9)
    """Share of the racket's acceleration that is left on the way to a place; of those as good, one with it is taken
    (choice)."""
    correct_ms: float = setting(55.0, 0.0, 300.0)
    """A place has that reserve only if the ball is hit so long after its bounce: that moves the hit by up to 10 mm,
    which is known 28 ms later at the earliest; half the time left takes four times the acceleration (our measurement: a
    third of the rackets came to their limit with 42 ms, a fifth with 55)."""
    fewest: float = setting(0.02, 0.0, 1.0)
    """With a smaller chance there is no stroke that returns the ball."""

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def xs_m(self) -> Array:
        """(K,) x of the candidates, descending; the paper's plane is among them."""
        before = np.arange(PAPER_X_M, self.nearest_x_m + 1e-9, self.step_m)
        behind = np.arange(PAPER_X_M, self.farthest_x_m - 1e-9, -self.step_m)
        return np.concatenate([before[:0:-1], behind])


@dataclass(frozen=True, slots=True)
class RacketReach:
    """Where the middle of the face may be, and how fast it moves."""

    home_m: tuple[float, float, float]
    reach_m: float
    """Farthest from home."""
    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]
    """Corners of a box that it never leaves; infinite where there is none."""
    max_speed_mps: float
    max_acceleration_mps2: float
    normal: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """From it the face's normal is turned away by no more than ..."""
    max_tilt_rad: float = math.pi

    @staticmethod
    def of_config(racket: RacketConfig) -> RacketReach:
        """The limits of the simulated racket."""
        x, y, z = racket.home_m.tolist()
        low, high = (-math.inf, -math.inf, -math.inf), (math.inf, math.inf, math.inf)
        speed, acceleration = racket.max_speed_mps, racket.max_acceleration_mps2
        return RacketReach((x, y, z), racket.reach_m, low, high, speed, acceleration)


class FaceTrajectory(NamedTuple):
    """The middle of the face at a time: position (3,), velocity (3,)."""

    t_s: float
    p_m: Array
    v_mps: Array

    def accelerations(self, t_s: float, p_m: Array, v_mps: Array) -> tuple[Array, Array]:
        """At the start and the end of the cubic that is at p_m with v_mps at t_s; in between it is linear."""
        left = max(t_s - self.t_s, 1e-6)
        gap, v, w = p_m - self.p_m, self.v_mps, v_mps
        return 6 * gap / left**2 - (4 * v + 2 * w) / left, -6 * gap / left**2 + (2 * v + 4 * w) / left

    def towards(self, t_s: float, p_m: Array, v_mps: Array, now_s: float) -> FaceTrajectory:
        """The racket at `now_s` on its way there; past t_s it goes on with that velocity."""
        if now_s >= t_s:
            return FaceTrajectory(now_s, p_m + v_mps * (now_s - t_s), v_mps)
        a, b = self.accelerations(t_s, p_m, v_mps)
        h, slope = now_s - self.t_s, (b - a) / max(t_s - self.t_s, 1e-6)
        p = self.p_m + self.v_mps * h + a * h * h / 2 + slope * h**3 / 6
        return FaceTrajectory(now_s, p, self.v_mps + a * h + slope * h * h / 2)


class Stroke(NamedTuple):
    """How a ball would be hit."""

    face_m: Array
    """(3,) middle of the face at the impact."""
    v_mps: Array
    """(3,) its velocity."""
    chance: float
    """Probability that the ball comes back."""
    landing_sigma_m: float
    """Standard deviation of where it lands."""
    normal: Array
    """(3,) of the face."""


class FlightAhead(Protocol):
    """A ball's flight as the choice asks for it: a prediction, or a flight that is known."""

    @property
    def t_us(self) -> int:
        """Time of the newest observation."""
        ...

    @property
    def stage(self) -> Stage:
        """Which side of the bounce that is on."""
        ...

    @property
    def bounces(self) -> Sequence[TablePoint]:
        """Bounces on the table after it."""
        ...

    def crossings(self, xs_m: ArrayLike) -> Sequence[HitPlane | None]:
        """The ball at planes (K,) of descending x; None where it never is."""
        ...


class StrokeModel(Protocol):
    """Says how a ball would be hit somewhere."""

    def stroke_at(self, hit: HitPlane, covariance: Array) -> Stroke | None:
        """The best stroke for the ball there, with (6, 6) how well it will be known; None without any."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class HitCandidate:
    """A place along the flight."""

    hit: HitPlane
    chance: float
    """Probability that the ball comes back from there, 0 to 1; 0 where `why_not` says something."""
    landing_sigma_m: float
    """Standard deviation of where it would land; infinite where it cannot be hit."""
    why_not: str
    """Why the ball cannot be hit there; empty if it can."""
    has_reserve: bool = False
    """Whether the racket has acceleration and time left for a correction after the bounce."""


@dataclass(frozen=True, slots=True, eq=False)
class HitChoice:
    """The chosen place, and all others that were looked at."""

    t_us: int
    """Time of the newest observation."""
    chosen: HitCandidate | None
    candidates: tuple[HitCandidate, ...]
    """In the order in which the ball comes there."""
    why_not: str
    """Why no stroke returns the ball; empty if one does."""

    @property
    def explanation(self) -> str:
        """In words, why no stroke returns the ball, and where one nearly could; empty if one does."""
        if not self.why_not:
            return ""
        near = [one for one in self.candidates if one.why_not == self.why_not]
        if not near:
            return cannot_be_returned(self.why_not, None)
        return cannot_be_returned(self.why_not, min(near, key=lambda one: abs(one.hit.p_world_m[0] - PAPER_X_M)).hit)


def plane_explanation(hit: HitPlane, config: HitChoiceConfig | None = None) -> str:
    """In words, why a ball that is hit at the plane only cannot be returned; empty if it is high enough there."""
    why_not = _too_low(hit, config or HitChoiceConfig())
    return cannot_be_returned(why_not, hit) if why_not else ""


def cannot_be_returned(why_not: str, hit: HitPlane | None) -> str:
    """The sentence for a reason, at a place if there is one."""
    where = "" if hit is None else f" at x = {hit.p_world_m[0]:.2f} m, z = {hit.p_world_m[2]:.2f} m"
    return f"Ball cannot be returned: {why_not}{where}"


def choose_hit(
    prediction: FlightAhead,
    model: StrokeModel,
    racket: FaceTrajectory,
    reach: RacketReach,
    config: HitChoiceConfig,
    *,
    bounced_s: float | None = None,
    kept_x_m: float | None = None,
) -> HitChoice:
    """The candidate with the best chance; `kept_x_m`, the one chosen before, unless another is clearly better.

    Args:
        prediction: the flight, with its covariance.
        model: how a ball is hit somewhere, and the chance that it comes back.
        racket: where the face is now, at the time from which it can move elsewhere.
        reach: what the racket can do.
        config: candidates and margins.
        bounced_s: when the ball bounced on the robot's half; None before that, or where it was not seen.
        kept_x_m: x of the hit that was chosen before; None without one.
    """
    there = [hit for hit in prediction.crossings(config.xs_m) if hit is not None]
    candidates = tuple(
        _judge(hit, prediction, bounced_s, model, racket, reach, config, is_kept=hit.p_world_m[0] == kept_x_m)
        for hit in there
    )
    possible = [one for one in candidates if not one.why_not]
    if not possible:
        return HitChoice(prediction.t_us, None, candidates, nearest_reason(candidates))
    best = max(one.chance for one in possible)
    good = [one for one in possible if one.chance >= best - config.enough]
    good = [one for one in good if one.has_reserve] or good
    most_m = (1 + config.alike) * min(one.landing_sigma_m for one in good)
    accurate = [one for one in good if one.landing_sigma_m <= most_m]
    chosen = min(accurate, key=lambda one: abs(one.hit.p_world_m[0] - PAPER_X_M))
    kept = next((one for one in possible if kept_x_m is not None and one.hit.p_world_m[0] == kept_x_m), None)
    enough = kept is not None and kept.chance >= chosen.chance - config.switch_gain
    if kept is not None and enough and (kept.has_reserve or not chosen.has_reserve):
        chosen = kept
    return HitChoice(prediction.t_us, chosen, candidates, "")


def _judge(
    hit: HitPlane,
    prediction: FlightAhead,
    bounced_s: float | None,
    model: StrokeModel,
    racket: FaceTrajectory,
    reach: RacketReach,
    config: HitChoiceConfig,
    *,
    is_kept: bool,
) -> HitCandidate:
    """A place and the chance there. To the place that is kept the racket is on its way, and small corrections are no
    question of time: shortly before the hit they take high accelerations over a millimetre.
    """
    since_s = _since_bounce_s(hit, prediction, bounced_s)
    why_not = _against_the_rules(hit, prediction, since_s, config) or _too_low(hit, config)
    if why_not:
        return HitCandidate(hit, 0.0, math.inf, why_not)
    stroke = model.stroke_at(hit, expected_covariance(hit, since_s, config))
    if stroke is None or stroke.chance < config.fewest:
        return HitCandidate(hit, 0.0, math.inf, NO_STROKE)
    why_not = _out_of_reach(stroke, hit.t_s, None if is_kept else racket, reach)
    if why_not:
        return HitCandidate(hit, 0.0, math.inf, why_not)
    hardest = max(float(np.linalg.norm(a)) for a in racket.accelerations(hit.t_s, stroke.face_m, stroke.v_mps))
    has_reserve = (
        hardest <= (1 - config.reserve) * reach.max_acceleration_mps2 and not since_s < 1e-3 * config.correct_ms
    )
    return HitCandidate(hit, stroke.chance, stroke.landing_sigma_m, "", has_reserve)


def _since_bounce_s(hit: HitPlane, prediction: FlightAhead, bounced_s: float | None) -> float:
    """Time from the bounce on the robot's half to the hit; -infinity if there is none, nan where it is not known."""
    if prediction.stage == "post":
        return math.nan if bounced_s is None else hit.t_s - bounced_s
    return hit.t_s - prediction.bounces[0].t_s if prediction.bounces else -math.inf


def _against_the_rules(hit: HitPlane, prediction: FlightAhead, since_s: float, config: HitChoiceConfig) -> str:
    if prediction.stage == "pre":
        if since_s == -math.inf:
            return NO_BOUNCE
        if since_s <= 0:
            return NOT_YET
        if since_s < 1e-3 * config.see_ms:
            return TOO_SOON
    second = prediction.bounces[0 if prediction.stage == "post" else 1 :]
    return TWICE if second and hit.t_s >= second[0].t_s else ""


def _too_low(hit: HitPlane, config: HitChoiceConfig) -> str:
    x, y, z = hit.p_world_m.tolist()
    radius_m = config.face_radius_m
    over_table = x - BALL_RADIUS_M > -TABLE_LENGTH_M / 2 and abs(y) < TABLE_WIDTH_M / 2 + radius_m
    if over_table and z < radius_m + config.table_gap_m:
        return TOO_LOW
    return BELOW if z < config.lowest_m else ""


def _out_of_reach(stroke: Stroke, t_s: float, racket: FaceTrajectory | None, reach: RacketReach) -> str:
    face, speed_mps = stroke.face_m, float(np.linalg.norm(stroke.v_mps))
    if speed_mps > reach.max_speed_mps:
        return TOO_SLOW
    low, high = np.array(reach.low_m), np.array(reach.high_m)
    # After the stroke it has to stop inside of its box too; a target that it cannot stop behind is refused.
    braked = face + stroke.v_mps * (speed_mps / (2 * reach.max_acceleration_mps2))
    outside = (np.minimum(face, braked) < low).any() or (np.maximum(face, braked) > high).any()
    if outside or float(np.linalg.norm(face - np.array(reach.home_m))) > reach.reach_m:
        return OUT_OF_REACH
    if math.acos(max(-1.0, min(1.0, float(stroke.normal @ np.array(reach.normal))))) > reach.max_tilt_rad:
        return TILTED
    if racket is None:
        return ""
    left_s = t_s - racket.t_s
    if left_s <= 0:
        return NO_TIME
    start, end = racket.accelerations(t_s, face, stroke.v_mps)
    if max(float(np.linalg.norm(start)), float(np.linalg.norm(end))) > reach.max_acceleration_mps2:
        return NO_TIME
    slope = (end - start) / left_s
    shares = np.linspace(0.0, left_s, 9)[:, None]
    fastest = float(np.linalg.norm(racket.v_mps + start * shares + slope * shares**2 / 2, axis=1).max())
    if fastest > reach.max_speed_mps:
        return TOO_SLOW
    way = racket.p_m + racket.v_mps * shares + start * shares**2 / 2 + slope * shares**3 / 6
    # A racket outside of its box may come back into it.
    low, high = np.minimum(low, racket.p_m) - ROUNDING_M, np.maximum(high, racket.p_m) + ROUNDING_M
    return WAY_OUT if ((way < low) | (way > high)).any() else ""


def expected_covariance(hit: HitPlane, since_s: float, config: HitChoiceConfig) -> Array:
    """(6, 6) how well position and velocity at the hit will be known when the last decision on it is made.

    Before the bounce the prediction knows the ball's place behind it badly, the farther behind the worse. But the ball
    will be seen after it too: the longer, the better. Both bounds hold; the smaller one of each direction counts.
    """
    if not math.isfinite(since_s):
        return hit.covariance
    blind_s = 0.9e-3 * config.see_ms
    seen_s = max(since_s - blind_s, 1 / config.rate_hz)
    points = max(2.0, seen_s * config.rate_hz)
    v_sigma = config.point_sigma_m * math.sqrt(12 / points) / seen_s
    p_sigma = math.hypot(config.point_sigma_m / math.sqrt(points), v_sigma * (seen_s / 2 + blind_s))
    sigmas = np.sqrt(np.maximum(hit.covariance.diagonal(), 1e-18))
    scale = np.minimum(1.0, np.repeat([p_sigma, v_sigma], 3) / sigmas)
    return hit.covariance * np.outer(scale, scale)


def nearest_reason(candidates: Sequence[HitCandidate]) -> str:
    """Why no stroke returns a ball: the reason of the candidate that came nearest to one."""
    return max((one.why_not for one in candidates), key=REASONS.index, default="the ball does not come to the racket")
