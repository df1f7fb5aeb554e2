"""How points of a flight move, and the units in which they move as a table-tennis ball does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPEEDS_MPS: Final = (0.2, 60.0)
"""Greatest speed of a ball in play, noise included: the fastest strokes have 35 m/s."""
LIKELY_MPS: Final = (1.0, 40.0)
"""Median speed of a flight, by which its units are guessed. Chosen by hand; not measured."""
FALLS_MPS2: Final = (3.0, 30.0)
"""Gravity is 9.8; spin and drag of a fast ball add or take up to twice that."""
WIDEST_M: Final = 12.0
"""Range for a flight."""
FEWEST: Final = 5
"""Points from which a motion is measured, and rows of which one may be odd."""
FEWEST_FOR_FALL: Final = 8
"""Points from which gravity is measured. Chosen by hand; not measured."""
FEWEST_FOR_SLOPE: Final = 4
SLOPE_S: Final = 0.03
"""Time before and after a bounce from which its speeds are told: gravity changes them by 0.3 m/s."""
TURN_MPS: Final = 1.0
"""Speed downwards before, and upwards after a bounce."""
ABOVE_TABLE_M: Final = 0.2
"""Height at a bounce that no error of a calibration makes of the ball's radius."""
LONGEST_PAUSE_S: Final = 0.05
SHORTEST_FLIGHT_S: Final = 0.2
"""In a quarter of it, errors of 1 mm at 500 Hz make 2 m/s2 of acceleration."""
NEIGHBOURS: Final = 3
"""Points before and after one from which it has to be reachable. Chosen by hand; not measured."""
JITTER_M: Final = 0.5
"""Error of a point that is not taken for an outlier, as far as speed goes."""
ODD_SHARE: Final = 0.1
"""Share of the rows of a file that may be odd."""
TIME_UNITS: Final = (1.0, 1e-3, 1e-6, 1e-9)
PLACE_UNITS: Final = (1.0, 1e-2, 1e-3)
TIME_FACTORS: Final = (1e-3, 1e-6, 1e-9, 1e3, 1e6)
PLACE_FACTORS: Final = (1e-3, 1e-2, 1e2, 1e3)
"""What a wrong unit multiplies by."""
NAMES: Final = {1.0: "", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n"}
INCH_M: Final = 0.0254
GRAVITY_MPS2: Final = 9.81


@dataclass(frozen=True, slots=True)
class Motion:
    """How points move."""

    speed_mps: float
    """Median."""
    fall_mps2: float | None
    """Median downward acceleration; None for too few points."""
    extent_m: float
    along_y: bool
    """More along y than along x."""
    away: bool
    """Towards +x."""

    @property
    def is_a_flight(self) -> bool:
        """The speed is one of a ball in play."""
        return SPEEDS_MPS[0] <= self.speed_mps <= SPEEDS_MPS[1]

    @property
    def odd_fall(self) -> bool:
        """The ball falls much more slowly or faster than any."""
        return self.fall_mps2 is not None and not FALLS_MPS2[0] <= self.fall_mps2 <= FALLS_MPS2[1]


@dataclass(frozen=True, slots=True)
class Units:
    """Units of times and places."""

    time_s: float
    place_m: float

    def __str__(self) -> str:
        place = "inches" if self.place_m == INCH_M else f"{NAMES[self.place_m]}m"
        return f"times in {NAMES[self.time_s]}s and places in {place}"


def measure_motion(t_s: Array, ps_m: Array) -> Motion | None:
    """The motion of points (N, 3) at ascending times (N,); None for fewer than `FEWEST`."""
    if len(t_s) < FEWEST or not t_s[-1] > t_s[0]:
        return None
    apart = max(1, len(t_s) // 10)  # over some points, so that their noise counts less
    steps_s = t_s[apart:] - t_s[:-apart]
    steps_m = np.linalg.norm(ps_m[apart:] - ps_m[:-apart], axis=1)
    speed = float(np.median(steps_m[steps_s > 0] / steps_s[steps_s > 0]))
    moved = ps_m[-1] - ps_m[0]
    extent = float(np.ptp(ps_m, axis=0).max())
    along_y = bool(abs(moved[1]) > 1.5 * abs(moved[0]) and abs(moved[1]) > 0.5)
    return Motion(speed, _fall(t_s, ps_m[:, 2]), extent, along_y, bool(moved[0] > 0.5))


def bounce_heights(t_s: Array, ps_m: Array) -> list[float]:
    """Lowest height at each bounce of points (N, 3) at ascending times (N,).

    A bounce turns a fall into a rise, and not the ball's direction, as a racket does.
    """
    found: list[tuple[float, float]] = []
    firsts, ends = np.searchsorted(t_s, t_s - SLOPE_S), np.searchsorted(t_s, t_s + SLOPE_S)
    for k, (first, end) in enumerate(zip(firsts, ends, strict=True)):
        if min(k - first, end - k) < FEWEST_FOR_SLOPE:
            continue
        before, after = (_slope(t_s[side], ps_m[side]) for side in (slice(first, k), slice(k, end)))
        if before[2] < -TURN_MPS and after[2] > TURN_MPS and before[:2] @ after[:2] > 0:
            low_m = float(ps_m[first:end, 2].min())
            if found and t_s[k] - found[-1][0] < SLOPE_S:
                low_m = min(low_m, found.pop()[1])
            found.append((float(t_s[k]), low_m))
    return [low_m for _, low_m in found]


def _slope(t_s: Array, ps_m: Array) -> Array:
    """Velocity (3,) of the straight line through points."""
    t = t_s - t_s.mean()
    return t @ ps_m / (t @ t)


def fall_of_flights(t_s: Array, ps_m: Array) -> float | None:
    """Median downward acceleration, m/s2, of all flights in points (N, 3) at ascending times (N,); None for none.

    A flight ends where no point comes for `LONGEST_PAUSE_S`; short ones are passed over.
    """
    pauses = np.flatnonzero(np.diff(t_s) > LONGEST_PAUSE_S) + 1
    flights = [part for part in np.split(np.arange(len(t_s)), pauses) if len(part)]
    lasting = [part for part in flights if t_s[part[-1]] - t_s[part[0]] > SHORTEST_FLIGHT_S]
    falls = [fall for part in lasting if (fall := _fall(t_s[part], ps_m[part, 2])) is not None]
    return float(np.median(falls)) if falls else None


def _fall(t_s: Array, z_m: Array) -> float | None:
    """Median over stretches of the downward acceleration: most stretches have no bounce in them."""
    if len(t_s) < FEWEST_FOR_FALL:
        return None
    size = max(FEWEST_FOR_FALL, len(t_s) // 4)
    falls: list[float] = []
    for start in range(0, len(t_s) - size + 1, max(1, size // 4)):
        t = t_s[start : start + size]
        scale = float(np.ptp(t))
        if scale <= 0:
            return None
        falls.append(-2 * float(np.polyfit((t - t.mean()) / scale, z_m[start : start + size], 2)[0]) / scale**2)
    return float(np.median(falls))


def reachable(t_s: Array, ps_m: Array) -> NDArray[np.bool_]:
    """Which points (N,) a ball can fly to from at least half of the three before and the three after them."""
    count = len(t_s)
    near, asked = np.zeros(count, int), np.zeros(count, int)
    for step in range(1, min(NEIGHBOURS, count - 1) + 1):
        far_m = np.linalg.norm(ps_m[step:] - ps_m[:-step], axis=1)
        met = far_m <= JITTER_M + SPEEDS_MPS[1] * np.abs(t_s[step:] - t_s[:-step])
        for side in (slice(step, None), slice(None, -step)):
            near[side] += met
            asked[side] += 1
    return 2 * near >= asked


def allowed_odd(rows: int) -> int:
    """How many odd rows of a file are left out; more refuse it."""
    return max(1, int(ODD_SHARE * rows)) if rows >= FEWEST else 0


def find_units(table: Array, time_s: float | None, place_m: float | None) -> list[Units]:
    """The units in which rows (N, 4) of time and place fly as a ball does; those that are known are kept.

    Inches are among them where places in centimetres would fall farther off gravity than in inches.
    """
    found: list[Units] = []
    for time in TIME_UNITS if time_s is None else (time_s,):
        for place in PLACE_UNITS if place_m is None else (place_m,):
            t_s, ps_m = time * table[:, 0], place * table[:, 1:]
            kept = reachable(t_s, ps_m)
            if len(kept) - kept.sum() > allowed_odd(len(kept)):
                continue
            motion = measure_motion(t_s[kept], ps_m[kept])
            if motion is None or motion.fall_mps2 is None or motion.odd_fall or motion.extent_m > WIDEST_M:
                continue
            if LIKELY_MPS[0] <= motion.speed_mps <= LIKELY_MPS[1]:
                found.append(Units(time, place))
                # 3.9 m/s2 in cm is gravity in inches; both are in the wide range that spin needs.
                if place == 1e-2 and place_m is None and motion.fall_mps2**2 * INCH_M / place < GRAVITY_MPS2**2:
                    found.append(Units(time, INCH_M))
    return found


def other_units(t_s: Array, ps_m: Array) -> str:
    """What to do about points that do not fly as a ball in the units of their columns' names."""
    fits = [
        (time, place)
        for time in (1.0, *TIME_FACTORS)
        for place in (1.0, *PLACE_FACTORS)
        if find_units(np.column_stack([time * (t_s - t_s[0]), place * ps_m]), 1.0, 1.0)
    ]
    if len(fits) != 1:
        return "name the columns after their units: t_s, t_ms, t_us or t_ns, and x_m, x_cm or x_mm"
    parts = [
        f"{what} multiplied by {factor:g}"
        for what, factor in zip(("times", "places"), fits[0], strict=True)
        if factor != 1
    ]
    return f"it would with {' and '.join(parts)}: name the columns after their units, as t_ms, x_mm"
