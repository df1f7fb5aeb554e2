"""Check of a racket target against the robot's limits, before it is sent and on arrival.

The way to a target is taken to be the cubic of least squared acceleration, axis by axis, from where the racket is now.
A robot may move otherwise; one that cannot, or needs more room or force for it, has to tell tighter limits.

The arbiter decides which targets a robot accepts, and how long it follows one. No target is carried out that is stale,
older than one before, of before a stop, or outside of the limits: however late, often or out of order it arrives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.chain.control.hit_choice import RacketReach
from core.robot.robot_messages import TURN_BOUND, RobotLimits, RobotTarget

Array = NDArray[np.float64]
ROUNDING: Final = 1e-9
"""Limits are kept to this share of themselves."""


@dataclass(frozen=True, slots=True, eq=False)
class FaceMotion:
    """Pose of the racket's face in the world: position (3,), orientation (4,) wxyz, velocity (3,)."""

    p_m: Array
    q_wxyz: Array
    v_mps: Array

    @staticmethod
    def of(p_m: object, q_wxyz: object, v_mps: object) -> FaceMotion:
        """From anything that numpy makes arrays of.

        Raises:
            ValueError: if that cannot be done, or the shapes are others.
        """
        p, q, v = (np.asarray(value, np.float64) for value in (p_m, q_wxyz, v_mps))
        if (p.shape, q.shape, v.shape) != ((3,), (4,), (3,)):
            raise ValueError(f"shapes {p.shape}, {q.shape}, {v.shape} instead of (3,), (4,), (3,)")
        return FaceMotion(p, q, v)

    def after(self, seconds: float) -> FaceMotion:
        """Pose after some time at constant velocity."""
        return FaceMotion(self.p_m + self.v_mps * seconds, self.q_wxyz, self.v_mps)

    @property
    def finite(self) -> bool:
        """Whether all values are finite."""
        return bool(np.isfinite(self.p_m).all() and np.isfinite(self.q_wxyz).all() and np.isfinite(self.v_mps).all())


class MotionFault(NamedTuple):
    """Why a target is rejected."""

    why: str
    """One of WHY in `robot_messages`."""
    detail: str


def find_fault(
    goal: FaceMotion,
    turn_radps: tuple[float, ...] | None,
    lead_us: int,
    now: FaceMotion,
    limits: RobotLimits,
) -> MotionFault | None:
    """Fault of reaching `goal` in `lead_us`; None if there is none.

    Args:
        goal: pose and velocity of the face at the impact.
        turn_radps: (3,) turn rate there; None: not given.
        lead_us: time until the impact.
        now: the face now.
        limits: of the robot.
    """
    if not goal.finite or (turn_radps is not None and not np.isfinite(turn_radps).all()):
        return MotionFault("bounds", "a number of the target is not finite")
    if not now.finite:
        return MotionFault("bounds", "it is not known where the racket is")
    with np.errstate(over="ignore", invalid="ignore"):
        return _static_fault(goal, turn_radps, limits) or _way_fault(goal, lead_us, now, limits)


def _static_fault(goal: FaceMotion, turn_radps: tuple[float, ...] | None, limits: RobotLimits) -> MotionFault | None:
    """Fault of the target itself. Compared with `not <=`, so that NaN never passes."""
    speed, length = float(np.linalg.norm(goal.v_mps)), float(np.linalg.norm(goal.q_wxyz))
    if not abs(length - 1) <= 1e-3:
        return MotionFault("bounds", f"not a unit quaternion: its length is {length:.4g}")
    if not _inside(goal.p_m, limits):
        return MotionFault("bounds", f"{_place(goal.p_m)} is outside of the box {_box(limits)}")
    if not speed <= limits.max_speed_mps:
        return MotionFault("bounds", f"{speed:.2f} m/s, at most {limits.max_speed_mps:g}")
    tilt = math.acos(min(1.0, max(-1.0, float(np.dot(face_normal(goal.q_wxyz), limits.normal)))))
    if not tilt <= limits.max_tilt_rad:
        most = math.degrees(limits.max_tilt_rad)
        return MotionFault("bounds", f"the face is tilted by {math.degrees(tilt):.0f} degrees, at most {most:.0f}")
    if turn_radps is not None:
        rate = float(np.linalg.norm(turn_radps))
        if len(turn_radps) != 3 or not rate <= min(limits.max_turn_rate_radps, TURN_BOUND):
            return MotionFault("bounds", f"turns by {rate:.1f} rad/s, at most {limits.max_turn_rate_radps:g}")
    braked = goal.p_m + goal.v_mps * (speed / (2 * limits.max_acceleration_mps2))
    if not _inside(braked, limits):
        return MotionFault("bounds", f"at {_place(goal.p_m)} with {speed:.2f} m/s it cannot stop inside of its box")
    return None


def _way_fault(goal: FaceMotion, lead_us: int, now: FaceMotion, limits: RobotLimits) -> MotionFault | None:
    """Fault of the motion to the target, and of its time."""
    if lead_us <= 0:
        return MotionFault("late", f"the impact was {-lead_us / 1e3:.0f} ms ago")
    if lead_us > limits.max_lead_us:
        return MotionFault("early", f"the impact is in {lead_us / 1e6:.2f} s, at most {limits.max_lead_us / 1e6:g}")
    left_s = lead_us * 1e-6
    angle = turned_by(now.q_wxyz, goal.q_wxyz)
    if not angle <= limits.max_turn_rate_radps * left_s + 1e-6:
        detail = (
            f"{math.degrees(angle):.0f} degrees in {1e3 * left_s:.0f} ms, at most {limits.max_turn_rate_radps:g} rad/s"
        )
        return MotionFault("unreachable", detail)
    at_start, at_end = cubic_accelerations(goal, left_s, now)
    # The acceleration of a cubic is linear in time: it is largest at an end.
    hardest = max(float(np.linalg.norm(at_start)), float(np.linalg.norm(at_end)))
    if not hardest <= limits.max_acceleration_mps2 * (1 + ROUNDING):
        detail = (
            f"takes {hardest:.0f} m/s2 to be there in {1e3 * left_s:.0f} ms, at most {limits.max_acceleration_mps2:g}"
        )
        return MotionFault("unreachable", detail)
    fastest, low, high = _extremes(now, at_start, at_end, left_s)
    if not fastest <= limits.max_speed_mps * (1 + ROUNDING) + 1e-6:
        detail = f"takes {fastest:.2f} m/s to be there in {1e3 * left_s:.0f} ms, at most {limits.max_speed_mps:g}"
        return MotionFault("unreachable", detail)
    if not (_inside(low, limits, now) and _inside(high, limits, now)):
        return MotionFault("unreachable", f"the way there leaves the box {_box(limits)}")
    return None


def reach_of(limits: RobotLimits) -> RacketReach:
    """The limits as the choice of the hit takes them; the box bounds the place, and its middle stands for the home."""
    (low_x, low_y, low_z), (high_x, high_y, high_z) = limits.low_m, limits.high_m
    normal_x, normal_y, normal_z = limits.normal
    return RacketReach(
        home_m=((low_x + high_x) / 2, (low_y + high_y) / 2, (low_z + high_z) / 2),
        reach_m=math.inf,
        low_m=(low_x, low_y, low_z),
        high_m=(high_x, high_y, high_z),
        max_speed_mps=limits.max_speed_mps,
        max_acceleration_mps2=limits.max_acceleration_mps2,
        normal=(normal_x, normal_y, normal_z),
        max_tilt_rad=limits.max_tilt_rad,
    )


def cubic_accelerations(goal: FaceMotion, left_s: float, now: FaceMotion) -> tuple[Array, Array]:
    """At its start and its end, of the cubic from now to the goal; in between it is linear."""
    gap, v, w = goal.p_m - now.p_m, now.v_mps, goal.v_mps
    return 6 * gap / left_s**2 - (4 * v + 2 * w) / left_s, -6 * gap / left_s**2 + (2 * v + 4 * w) / left_s


def face_normal(q_wxyz: Array) -> Array:
    """The x axis of an orientation, for a quaternion of about length one."""
    w, x, y, z = q_wxyz / np.linalg.norm(q_wxyz)
    return np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])


def turned_by(a_wxyz: Array, b_wxyz: Array) -> float:
    """The angle between two orientations."""
    scale = float(np.linalg.norm(a_wxyz) * np.linalg.norm(b_wxyz))
    return 2 * math.acos(min(1.0, abs(float(np.dot(a_wxyz, b_wxyz))) / scale)) if scale > 0 else math.nan


def _extremes(now: FaceMotion, at_start: Array, at_end: Array, left_s: float) -> tuple[float, Array, Array]:
    """The highest speed on the cubic (looked at in 65 places), and the corners of the box that it stays in."""
    slope = (at_end - at_start) / left_s
    shares = np.linspace(0.0, left_s, 65)[:, None]
    speeds = np.linalg.norm(now.v_mps + at_start * shares + slope * shares**2 / 2, axis=1)
    times = [np.zeros(3), np.full(3, left_s), *_turning_points(now.v_mps, at_start, slope, left_s)]
    places = np.array([now.p_m + now.v_mps * t + at_start * t**2 / 2 + slope * t**3 / 6 for t in times])
    return float(speeds.max()), places.min(axis=0), places.max(axis=0)


def _turning_points(v: Array, a: Array, slope: Array, left_s: float) -> tuple[Array, Array]:
    """For each axis the two times at which it turns back, moved into the way where there are none."""
    root = np.sqrt(np.maximum(a * a - 2 * slope * v, 0.0))
    with np.errstate(divide="ignore"):
        early, late, linear = (-a - root) / slope, (-a + root) / slope, -v / a
    straight = np.abs(slope) * left_s <= 1e-12 * (np.abs(a) + 1e-300)
    times = (np.where(straight, linear, early), np.where(straight, linear, late))
    return tuple(np.clip(np.nan_to_num(t, nan=0.0, posinf=left_s, neginf=0.0), 0.0, left_s) for t in times)  # type: ignore[reportReturnType]


def _inside(p: Array, limits: RobotLimits, start: FaceMotion | None = None) -> bool:
    """Whether a place is in the box; a way that starts outside of it may lead back from there."""
    low, high = np.array(limits.low_m), np.array(limits.high_m)
    if start is not None:
        low, high = np.minimum(low, start.p_m), np.maximum(high, start.p_m)
    return bool(((p >= low - ROUNDING) & (p <= high + ROUNDING)).all())


def _place(p: Array) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in p) + ") m"


def _box(limits: RobotLimits) -> str:
    return f"{_place(np.array(limits.low_m))} to {_place(np.array(limits.high_m))}"


AHEAD_US: Final = 20_000
"""Tolerance for targets sent in the future by our clock, whose sender does not know the clock."""
OLDEST_US: Final = 150_000
"""Largest age of a target at its start, whatever its own validity."""
FOLLOW_US: Final = 80_000
"""A target is followed this long after the impact, for a late ball."""
SILENT_US: Final = 500_000
"""Silence of the commander after which its target is dropped."""
NOT_STARTED: Final = "not started yet: a person has to"


class TargetArbiter:
    """Decides which target one robot follows, on its clock; used by one thread. It starts stopped."""

    def __init__(self, limits: RobotLimits) -> None:
        self.limits = limits
        self.stopped, self.reason = "robot", NOT_STARTED
        """Who stopped it ("" if it is not stopped), and why."""
        self._target: RobotTarget | None = None
        self._newest_id = 0
        self._received_us: int | None = None
        self._looked_us = 0

    def hear(self, now_us: int) -> None:
        """Note a sign of life of the commander."""
        self._received_us = now_us

    def begin_anew(self) -> None:
        """Reset for a new commander: the target is dropped, and a person has to start the robot."""
        self._newest_id = 0
        self.stop(self.stopped or "robot", self.reason or NOT_STARTED)

    def offer(self, target: RobotTarget, motion: FaceMotion, now_us: int) -> MotionFault | None:
        """Accept a target, or return the fault. `motion` is how the racket moves now."""
        is_newer = target.id > self._newest_id
        self._newest_id = max(self._newest_id, target.id)
        fault = self._fault(target, motion, now_us, is_newer=is_newer)
        if fault is None:
            self._target = target
        return fault

    def target(self, now_us: int) -> RobotTarget | None:
        """The one to carry out now; None: there is none, hold still or go to rest."""
        found, looked_us, self._looked_us = self._target, self._looked_us, now_us
        if found is None:
            return None
        gone = self._received_us is None or now_us - self._received_us > SILENT_US
        if self.stopped or gone or now_us < looked_us or now_us > found.impact_us + FOLLOW_US:
            self._target = None
        return self._target

    def stop(self, by: str, reason: str, number: int = 0) -> None:
        """Drop what is carried out, and take nothing until `start`."""
        self._newest_id = max(self._newest_id, number)
        self._target = None
        self.stopped, self.reason = by, reason

    def start(self, number: int) -> bool:
        """A person wants it to play: what was sent before that is over. False for one from before a later request."""
        if number <= self._newest_id:
            return False
        self._newest_id = number
        self.stopped = self.reason = ""
        return True

    def _fault(self, target: RobotTarget, motion: FaceMotion, now_us: int, *, is_newer: bool) -> MotionFault | None:
        if self.stopped:
            return MotionFault("stopped", f"stopped by {self.stopped}: {self.reason}")
        if not is_newer:
            return MotionFault("older", "a newer one was here before")
        if target.sent_us > now_us + AHEAD_US:
            return MotionFault("clock", f"sent in {(target.sent_us - now_us) / 1e3:.0f} ms from now, by our clock")
        if now_us > min(target.valid_until_us, target.sent_us + OLDEST_US):
            return MotionFault("stale", f"under way for {(now_us - target.sent_us) / 1e3:.0f} ms, too late to begin")
        goal = FaceMotion.of(target.p_m, target.q_wxyz, target.v_mps)
        return find_fault(goal, target.turn_radps, target.impact_us - now_us, motion, self.limits)
