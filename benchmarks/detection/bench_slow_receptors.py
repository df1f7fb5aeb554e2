"""`refined` on slow photoreceptors, with each event of a pixel that can mark the trailing edge.

The sensor is modelled on v2e, not on `core.simulation`: pictures every 0.1 ms, the logarithm above 20 of 255 and a line
below, a first-order low-pass whose cutoff is proportional to the light, (light + 20) / 275, an event for each change
over the threshold since the last one. So whatever is brighter, ball or ground, is followed fast, the other one slowly:
on a dark ground the trailing edge of a bright ball has a tail of several milliseconds.

Each flight is a ball of its own size, speed and brightness before a ground of its own. Errors are after one delay for
each flight, the median lag along the motion over the speed: a sensor in a room has one. The lags' spread over the
flights is a column, for with one delay for all of them it is an error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine
from core.detection.refined.detector import RefinedDetector
from core.detection.refined_config import RefinedConfig
from core.events import Events, SensorSize, Window
from core.jit import njit

SENSOR: Final = SensorSize(640, 360)
CUTOFFS_HZ: Final = (150.0, 300.0, 500.0)
COUNT: Final = 12
"""Flights of each row."""
STEP_US: Final = 100
END_MS: Final = 140
SETTLING_MS: Final = 10
"""Recall counts from here on after the whole ball has come into view."""
FALSE_PX: Final = 8.0
FALSE_MS: Final = 2.0
"""A slow receptor's answers lag; false are those that are farther away than 8 px and 2 ms of motion."""
NOISE_HZ: Final = 0.5
EDGE_PX: Final = 1.6
SHADE: Final = 0.3
"""The ball is brighter above than below by this share, up and down."""
GROUNDS: Final = {
    "bright ball": ((40.0, 90.0), (180.0, 240.0)),
    "dark room": ((8.0, 40.0), (80.0, 200.0)),
    "dark ball": ((150.0, 200.0), (20.0, 50.0)),
    "low contrast": ((40.0, 90.0), (90.0, 130.0)),
}
"""Range of the ground's light and of the ball's, of 255."""
CONFIGS: Final = {
    "defaults": RefinedConfig(delay_us=0),
    'trailing = "first"': RefinedConfig(delay_us=0, trailing="first", stretch_min_ms=-1.0, stretch_max_ms=5.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class SlowFlight:
    """Events of one ball, and where it was."""

    events: Events
    path_px: NDArray[np.float64]
    """(N, 2) centre every `STEP_US`."""
    r_px: float

    def inside(self) -> NDArray[np.bool_]:
        """(N,) whether the whole ball is in view."""
        most = np.array([SENSOR.width_px - 1.0, SENSOR.height_px - 1.0]) - self.r_px
        return np.all((self.path_px > self.r_px) & (self.path_px < most), axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class FlightScore:
    """Answers of one flight."""

    asked: int
    found: int
    false: int
    lag_ms: float
    """nan without answers; so the errors are empty."""
    error_px: NDArray[np.float64]


def run(progress: Callable[[float], None], *, count: int = COUNT) -> dict[str, object]:
    """A row per cutoff, kind of light and setting."""
    rows: list[dict[str, object]] = []
    cases = [(cutoff_hz, light) for cutoff_hz in CUTOFFS_HZ for light in GROUNDS]
    for done, (cutoff_hz, light) in enumerate(cases):
        flights = [draw_slow_flight(light, cutoff_hz, seed) for seed in range(count)]
        for name, config in CONFIGS.items():
            scores = [score_slow_flight(flight, config) for flight in flights]
            rows.append({"cutoff_hz": cutoff_hz, "light": light, "settings": name} | summarise_flights(scores))
        progress((done + 1) / len(cases))
    return {"rows": rows, "machine": describe_machine("numba", "numpy", clock="none: counts and pixels")}


def draw_slow_flight(light: str, cutoff_hz: float, seed: int) -> SlowFlight:
    """The flight of a seed: the same for every cutoff."""
    rng = np.random.default_rng([seed, *light.encode()])
    r_px, speed_px_per_ms = float(rng.uniform(7.0, 14.0)), float(rng.uniform(1.0, 4.5))
    ms = np.arange(0.0, END_MS, 1e-3 * STEP_US)
    from_left = rng.random() < 0.5
    u = -20.0 + speed_px_per_ms * ms if from_left else SENSOR.width_px + 20.0 - speed_px_per_ms * ms
    v = rng.uniform(80.0, 240.0) + rng.uniform(-0.8, 0.8) * ms + 0.003 * ms * ms
    path = np.column_stack([u, v])[(u > -40.0) & (u < SENSOR.width_px + 40.0)]
    grounds, balls = GROUNDS[light]
    stripes = 1.0 + 0.15 * np.sin(np.arange(SENSOR.width_px) / 97.0)
    ground = np.tile(rng.uniform(*grounds) * stripes, (SENSOR.height_px, 1))
    shape = (2, SENSOR.height_px, SENSOR.width_px)
    thresholds = np.maximum(0.2 + 0.02 * rng.standard_normal(shape), 0.05)
    ball = float(rng.uniform(*balls))
    columns = _see_ball(path, r_px, ball, ground, cutoff_hz, thresholds)
    end_us = len(path) * STEP_US
    noise = rng.poisson(NOISE_HZ * 1e-6 * end_us * ground.size)
    extra = (
        rng.integers(0, end_us, noise), rng.integers(0, SENSOR.width_px, noise),
        rng.integers(0, SENSOR.height_px, noise), rng.random(noise) < 0.5,
    )  # fmt: skip
    t, x, y, on = (np.concatenate(pair) for pair in zip(columns, extra, strict=True))
    t = t + np.where(np.arange(len(t)) < len(columns[0]), rng.integers(0, STEP_US, len(t)), 0)  # not on a grid
    order = np.argsort(t, kind="stable")
    return SlowFlight(Events.from_columns(t[order], x[order], y[order], on[order], SENSOR), path, r_px)


def _see_ball(
    path: NDArray[np.float64],
    r_px: float,
    ball: float,
    ground: NDArray[np.float64],
    cutoff_hz: float,
    thresholds: NDArray[np.float64],
) -> tuple[NDArray[np.generic], ...]:
    room = 1 << 20
    while True:
        columns, on = np.empty((3, room), np.int64), np.empty(room, np.bool_)
        count = _pixels(path, r_px, ball, ground, cutoff_hz, thresholds, columns, on)
        if count <= room:
            return (*(column[:count] for column in columns), on[:count])
        room = 2 * count


@njit
def _logarithm(light):
    """Natural logarithm above 20 and a line through the origin below, as v2e has it."""
    return math.log(light) if light > 20.0 else light * math.log(20.0) / 20.0


@njit
def _pixels(path, r_px, ball, ground, cutoff_hz, thresholds, columns, on):
    """Write the events of the pixels that see the ball, as many as fit; how many there are."""
    height, width = ground.shape
    receptor, reference = np.empty((height, width)), np.empty((height, width))
    for y in range(height):
        for x in range(width):
            receptor[y, x] = reference[y, x] = _logarithm(ground[y, x])
    awake = np.zeros((height, width), np.bool_)
    share, count = 2.0 * math.pi * cutoff_hz * 1e-6 * STEP_US, 0
    for step in range(len(path)):
        u, v = path[step]
        for y in range(max(0, int(v - r_px - 3)), min(height, int(v + r_px + 4))):
            for x in range(max(0, int(u - r_px - 3)), min(width, int(u + r_px + 4))):
                awake[y, x] = True
        for y in range(height):
            for x in range(width):
                if not awake[y, x]:
                    continue
                cover = min(max((r_px - math.hypot(x - u, y - v)) / EDGE_PX + 0.5, 0.0), 1.0)
                cover = cover * cover * (3.0 - 2.0 * cover)
                lit = ball * (1.0 - SHADE * (y - v) / r_px)
                light = ground[y, x] + (lit - ground[y, x]) * cover
                goal = _logarithm(light)
                receptor[y, x] += min(1.0, share * (light + 20.0) / 275.0) * (goal - receptor[y, x])
                if cover == 0.0 and abs(receptor[y, x] - goal) < 1e-3:
                    awake[y, x] = False
                while True:
                    change = receptor[y, x] - reference[y, x]
                    if change >= thresholds[0, y, x]:
                        reference[y, x] += thresholds[0, y, x]
                    elif change <= -thresholds[1, y, x]:
                        reference[y, x] -= thresholds[1, y, x]
                    else:
                        break
                    if count < len(on):
                        columns[0, count], columns[1, count], columns[2, count] = step * STEP_US, x, y
                        on[count] = change > 0.0
                    count += 1
    return count


def score_slow_flight(flight: SlowFlight, config: RefinedConfig) -> FlightScore:
    """Answers every millisecond against the path."""
    detector = RefinedDetector(replace(config, delay_us=0), SENSOR)
    inside = flight.inside()
    first_us = int(np.argmax(inside)) * STEP_US + 1000 * SETTLING_MS
    asked = found = false = 0
    lags, along, across, speeds = [], [], [], []
    for end_us in range(1000, len(flight.path_px) * STEP_US, 1000):
        wanted = end_us >= first_us and bool(inside[end_us // STEP_US])
        asked += wanted
        one = detector.step(Window(flight.events.between(end_us - 1000, end_us), end_us - 1000, end_us))
        if one is None:
            continue
        step = end_us // STEP_US
        velocity = (flight.path_px[step] - flight.path_px[step - 1]) * 1000 / STEP_US
        speed = float(np.hypot(*velocity))
        off = np.array([one.u_px, one.v_px]) - flight.path_px[step]
        if np.hypot(*off) > FALSE_PX + FALSE_MS * speed:
            false += 1
            continue
        found += wanted
        along.append(float(off @ velocity) / speed)
        across.append(float(off[1] * velocity[0] - off[0] * velocity[1]) / speed)
        speeds.append(speed)
        lags.append(-along[-1] / speed)
    lag_ms = float(np.median(lags)) if lags else math.nan
    error_px = np.hypot(np.array(along) + lag_ms * np.array(speeds), np.array(across))
    return FlightScore(asked, found, false, lag_ms, error_px)


def summarise_flights(scores: list[FlightScore]) -> dict[str, object]:
    """Figures of a row."""
    errors = np.concatenate([one.error_px for one in scores])
    lags = [one.lag_ms for one in scores if not math.isnan(one.lag_ms)]
    return {
        "flights": len(scores),
        "recall": sum(one.found for one in scores) / max(1, sum(one.asked for one in scores)),
        "false": sum(one.false for one in scores),
        "median_px": float(np.median(errors)) if len(errors) else math.nan,
        "p95_px": float(np.percentile(errors, 95)) if len(errors) else math.nan,
        "lag_ms": float(np.median(lags)) if lags else math.nan,
        "lag_spread_ms": float(np.std(lags)) if lags else math.nan,
    }
