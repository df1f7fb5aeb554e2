"""The rivals and ours on the same drawn flights, which no rival was tuned on, and what a window costs each of them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.detection.drawn_scenes import DrawnFlight, Row, draw_flight
from benchmarks.machine import describe_machine
from core.cameras.presets import stereo_preset
from core.detection.methods import Method, make_detector, method_config
from core.metrics.grid_score import SLOW_PX_PER_MS, GridScore, score_on_grid
from core.metrics.run import run_detector
from core.metrics.timed import TimedDetector, one_opencv_thread
from core.physics.config import physics_profile
from core.recordings import CameraStream, open_recording
from core.simulation import simulate_recording

METHODS: Final[tuple[Method, ...]] = ("ebpp", "fe-fusion", "auto", "refined")
ROWS: Final[tuple[Row, ...]] = ("ball", "clutter")
FIRST: Final = 50_000
"""The rivals were tuned on flights from 1000 on; ours on others below `SCORED_FROM`, some of these perhaps."""
COUNT: Final = 20
"""Flights of each row; those with a ball only draw their noise, about a third of them each."""
RESAMPLES: Final = 1000
ANY_SPEED: Final = (0.0, 1e9)
FAST: Final = (SLOW_PX_PER_MS, 1e9)


@dataclass(slots=True)
class Tally:
    """What one method did on the flights of one kind."""

    flights: list[GridScore] = field(default_factory=list)
    """Of balls at any speed, both cameras of each flight."""
    fast: GridScore = field(default_factory=GridScore)
    """Of balls above `SLOW_PX_PER_MS`, all flights."""
    seconds: list[float] = field(default_factory=list)


def run(progress: Callable[[float], None], *, count: int = COUNT) -> dict[str, object]:
    """A row per kind of scene, noise and method, and the machine."""
    cases: list[tuple[Row, int]] = [(row, number) for row in ROWS for number in range(FIRST, FIRST + count)]
    tallies: dict[tuple[Row, float, Method], Tally] = {}
    with one_opencv_thread():
        for done, (row, number) in enumerate(cases):
            flight = draw_flight(row, number, any_sensor=False)
            for method in METHODS:
                tallies.setdefault((row, flight.stereo.sensor.noise_hz, method), Tally())
            _fly_past(flight, tallies)
            progress((done + 1) / len(cases))
    rows = [summarise(*key, tally) for key, tally in sorted(tallies.items(), key=lambda one: one[0][:2])]
    machine = describe_machine("numba", "opencv-python-headless", clock="processor time of one thread, warm")
    return {"rows": rows, "machine": machine}


def _fly_past(flight: DrawnFlight, tallies: dict[tuple[Row, float, Method], Tally]) -> None:
    """Simulate a flight, and add what every method says of both cameras."""
    with tempfile.TemporaryDirectory(prefix="rallyscope-bench-") as temporary:
        path = Path(temporary) / "flight.h5"
        cameras, physics = stereo_preset(flight.placement), physics_profile(flight.physics)
        simulate_recording(path, flight.stereo, cameras, [flight.launch], seed=flight.number, physics=physics)
        streams = list(open_recording(path).cameras.values())
        for method in METHODS:
            tally = tallies[flight.row, flight.stereo.sensor.noise_hz, method]
            tally.flights.append(sum((_add(stream, method, tally) for stream in streams), GridScore()))


def _add(stream: CameraStream, method: Method, tally: Tally) -> GridScore:
    """Note everything of one camera but its score at any speed, which is returned."""
    assert stream.truth is not None
    window_us = method_config(method).window.window_us
    detector = TimedDetector(make_detector(method, stream.sensor))
    answers = run_detector(stream, detector, window_us)
    tally.fast += score_on_grid(answers, stream.truth, stream.sensor, FAST, window_us=window_us)
    tally.seconds += detector.seconds
    return score_on_grid(answers, stream.truth, stream.sensor, ANY_SPEED, window_us=window_us)


def summarise(row: Row, noise_hz: float, method: Method, tally: Tally) -> dict[str, object]:
    """One row of the table: `fast` is of balls above 2 px/ms, `low` and `high` are the 95 % interval over flights."""
    every = sum(tally.flights, GridScore())
    precision_low, precision_high = interval_95(tally.flights, lambda score: score.precision)
    recall_low, recall_high = interval_95(tally.flights, lambda score: score.recall)
    p50_ms, p99_ms = (1e3 * np.percentile(tally.seconds, (50, 99))).tolist()
    return {
        "row": row,
        "noise_hz": noise_hz,
        "method": method,
        "window_us": method_config(method).window.window_us,
        "flights": len(tally.flights),
        "asked": every.asked,
        "precision": every.precision,
        "precision_low": precision_low,
        "precision_high": precision_high,
        "recall": every.recall,
        "recall_low": recall_low,
        "recall_high": recall_high,
        "recall_fast": tally.fast.recall,
        "median_px": every.error_at(50),
        "p95_px": every.error_at(95),
        "p50_ms": p50_ms,
        "p99_ms": p99_ms,
    }


def interval_95(flights: list[GridScore], figure: Callable[[GridScore], float]) -> tuple[float, float]:
    """Between what a figure lies in 95 % of the cases when as many flights are drawn from these with replacement."""
    rng = np.random.default_rng(0)
    chosen = rng.integers(0, len(flights), (RESAMPLES, len(flights)))
    counts = np.array([(one.asked, one.found, one.answers, one.false) for one in flights])[chosen].sum(axis=1)
    low, high = np.nanpercentile([figure(GridScore(*row)) for row in counts.tolist()], (2.5, 97.5)).tolist()
    return low, high
