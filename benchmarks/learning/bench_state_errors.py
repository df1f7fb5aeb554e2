"""Whether balls seen in closed form (`timed`) err at the decision as balls seen by event cameras do.

Serves of seeds that no training and no evaluation has are watched by two event cameras and the chain until the stroke
is decided; others, drawn alike, by `observe_in_time`. Compared are the errors of the state and of the time, by the
distance of Kolmogorov and Smirnov. The points of the chain are kept, and their errors fitted as `point_errors.MEASURED`
has them. Half of the balls, the even ones, are for the fit, the others for the comparison.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.machine import describe_machine
from benchmarks.partial_rows import report_rows_to
from core.chain.chain import ChainState
from core.files import replacing
from core.learning.config import EnvironmentConfig
from core.learning.task.environment import ServeBatch, draw_serve_batch
from core.learning.task.point_errors import PointErrors, SeenFlight, fit_point_errors
from core.live.worlds.event_environment import EventCameraBackend, EventEnvironmentConfig
from core.simulation.episodes.closed_form import sample_serves

Array = NDArray[np.float64]
Progress = Callable[[float], None]

FOLDER: Final = Path("rallyscope-data/bench-state-errors")
SEED: Final = 20260406
SPEEDS_MPS: Final = (3.0, 5.0, 9.0)
PER_SPEED: Final = 1000
"""Half of them are compared: the distance of two equal samples of 500 exceeds 0.086 once in twenty times."""
TIMED_BALLS: Final = 500
FEWEST_FLIGHTS: Final = 10
"""For a fit."""
AIMED_AT: Final = 0.1
NAMES: Final = ("y_mm", "z_mm", "vx_mmps", "vy_mmps", "vz_mmps", "t_ms")


@dataclass(frozen=True, slots=True, eq=False)
class WatchedBall:
    """One ball before the cameras, up to the decision."""

    flight: SeenFlight
    error: Array
    """(6,) as `NAMES`; NaN where nothing was predicted in time."""


def run(progress: Progress, *, folder: Path = FOLDER, count: int = PER_SPEED) -> dict[str, object]:
    """A row per speed: how many balls, the distance of every error, how far equal samples may be apart; and the fit."""
    watched: dict[float, list[WatchedBall]] = {speed: [] for speed in SPEEDS_MPS}
    backend = contextlib.ExitStack()
    with backend:
        camera = _Watching(backend)
        for number in range(count):
            for speed, balls in watched.items():
                balls.append(watched_ball(folder, speed, number, camera))
            progress(0.9 * (number + 1) / count)
    rows = [compare(speed, balls) for speed, balls in watched.items()]
    report_rows_to(progress, rows, 1.0)
    flights = [ball.flight for balls in watched.values() for ball in balls[::2] if len(ball.flight.t_s)]
    fit = fit_point_errors(flights) if len(flights) >= FEWEST_FLIGHTS else None
    return {"rows": rows, "fit": None if fit is None else as_values(fit), "machine": describe_machine("numpy", "numba")}


def compare(speed_mps: float, balls: list[WatchedBall]) -> dict[str, object]:
    """The odd balls of the chain against `timed` at the same speed: distances, and 5 % of equal samples lie beyond."""
    chain = np.array([ball.error for ball in balls[1::2]]).reshape(-1, len(NAMES))
    seen = chain[np.isfinite(chain).all(axis=1)]
    rng = np.random.default_rng([SEED, round(1000 * speed_mps), 1])
    timed = errors_of(draw_serve_batch(speed_mps, TIMED_BALLS, EnvironmentConfig(state_source="timed"), rng))
    timed_seen = timed[np.isfinite(timed).all(axis=1)]
    row: dict[str, object] = {
        "speed_mps": speed_mps,
        "chain_balls": len(chain),
        "chain_seen": len(seen) / max(1, len(chain)),
        "timed_seen": len(timed_seen) / len(timed),
    }
    distances = [_distance(seen[:, i], timed_seen[:, i]) for i in range(len(NAMES))]
    row |= {f"ks_{name}": value for name, value in zip(NAMES, distances, strict=True)}
    worst = max((value for value in distances if value is not None), default=None)
    by_chance = 1.358 * np.sqrt(1 / len(seen) + 1 / len(timed_seen)) if len(seen) and len(timed_seen) else None
    return row | {"worst": worst, "by_chance": by_chance, "agrees": worst is not None and worst < AIMED_AT}


def errors_of(balls: ServeBatch) -> Array:
    """(N, 6) as `NAMES` of what is known of the balls; NaN where nothing is."""
    states = 1e3 * (balls.states - balls.arrivals.observations)[:, 1:]
    assert balls.aim_t_s is not None
    errors = np.column_stack([states, 1e3 * (balls.aim_t_s - balls.arrivals.t_s)])
    return np.where(balls.seen[:, None], errors, np.nan)


def watched_ball(folder: Path, speed_mps: float, number: int, camera: _Watching) -> WatchedBall:
    """The ball of a speed with a number: from its file, or watched now and kept."""
    path = folder / f"{speed_mps:g}mps-{number:04d}.npz"
    if not path.exists():
        ball = camera.watch(speed_mps, number)
        columns: dict[str, Any] = {name: getattr(ball.flight, name) for name in ("t_s", "truth_m", "errors_m")}
        with replacing(path, durable=False) as partial, partial.open("wb") as file:
            np.savez(file, **columns, bounce_t_s=ball.flight.bounce_t_s, error=ball.error)
    with np.load(path) as file:
        flight = SeenFlight(file["t_s"], file["truth_m"], file["errors_m"], float(file["bounce_t_s"]))
        return WatchedBall(flight, file["error"])


class _Watching:
    """Event cameras that are set up when the first ball needs them."""

    def __init__(self, ends: contextlib.ExitStack) -> None:
        self._ends = ends
        self._environment = EnvironmentConfig(state_source="events")
        self._backend: EventCameraBackend | None = None
        self._points: list[tuple[float, Array]] = []

    def watch(self, speed_mps: float, number: int) -> WatchedBall:
        """Serve a ball and watch it until the stroke has to be decided."""
        if self._backend is None:
            backend = EventCameraBackend(
                self._environment, seed=SEED, config=EventEnvironmentConfig(told=True), heard=self._hear
            )
            self._backend = self._ends.enter_context(contextlib.closing(backend))
        rng = np.random.default_rng([SEED, round(1000 * speed_mps), 0, number])
        dealt = draw_serve_batch(speed_mps, 1, self._environment, rng)
        self._points.clear()
        met = self._backend.observe(dealt)
        t_s = np.array([t for t, _ in self._points])
        truth_m = sample_serves(dealt.serves, dealt.arrivals, t_s[None], self._environment.task)[0]
        seen_m = np.array([p for _, p in self._points]).reshape(-1, 3)
        flight = SeenFlight(t_s, truth_m, seen_m - truth_m, float(dealt.arrivals.bounce_t_s[0]))
        return WatchedBall(flight, errors_of(met)[0])

    def _hear(self, state: ChainState, served_s: float) -> None:
        if state.point is not None and 1e-6 * state.point.t_us > served_s:
            self._points.append((1e-6 * state.point.t_us - served_s, state.point.p_world_m.copy()))


def as_values(errors: PointErrors) -> dict[str, object]:
    """The fit as it stands in `point_errors.py`."""
    names = ("explained", "bias", "drift", "noise")
    values: dict[str, object] = {name: getattr(errors, name).round(3).tolist() for name in names}
    return values | {"drift_s": round(errors.drift_s, 4)}


def _distance(a: Array, b: Array) -> float | None:
    if not (len(a) and len(b)):
        return None
    found: Any = stats.ks_2samp(a, b)  # scipy has no types for it
    return float(found.statistic)
