"""Quick synthetic scenes for the detector: a disc's edge crossing pixels, and noise. Exact, so truth is exact."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from benchmarks.detector_training.crops import BallStreak, draw_streak
from benchmarks.detector_training.pool import LabelledPictures
from core.detection.window import windows_between
from core.detection.yolo.weights import YoloWeights, load_weights
from core.events import CameraFrame, Events, SensorSize, Window
from tests.drawn_circles import draw_circles


@dataclass(frozen=True)
class Flight:
    """A disc that moves in a straight line from (u, v) at 0 us."""

    u_px: float = 60.0
    v_px: float = 120.0
    du_px_per_ms: float = 2.0
    dv_px_per_ms: float = 0.3
    r_px: float = 9.0
    bright: bool = True

    def centre(self, t_us: float) -> tuple[float, float]:
        return self.u_px + self.du_px_per_ms * t_us / 1000, self.v_px + self.dv_px_per_ms * t_us / 1000


@dataclass(frozen=True)
class Scene:
    """Events in memory, served like a camera of a recording."""

    events: Events
    duration_us: int

    def slice(self, start_us: int, end_us: int) -> Events:
        return self.events.between(start_us, end_us)

    def windows(self, window_us: int = 2000) -> list[Window]:
        return list(windows_between(self, 0, self.duration_us, window_us))


def edge_events(
    flight: Flight, duration_us: int, sensor: SensorSize, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Four events around each moment the disc's edge passes a pixel's centre: one polarity in, the other one out."""
    y, x = (axis.ravel() for axis in np.mgrid[: sensor.height_px, : sensor.width_px])
    v = np.array([flight.du_px_per_ms, flight.dv_px_per_ms]) / 1000
    off = np.stack([x - flight.u_px, y - flight.v_px], axis=1)
    closest = off @ v / (v @ v)
    gap = flight.r_px**2 - ((off - closest[:, None] * v) ** 2).sum(axis=1)
    hit = gap > 0
    half = np.sqrt(gap[hit] / (v @ v))
    columns = []
    for side, on in ((-1, flight.bright), (1, not flight.bright)):
        for number in range(4):
            blur_us = (number - 1.5) * 0.4 / np.hypot(*v) + rng.normal(0, 20, hit.sum())
            t = closest[hit] + side * half + blur_us
            inside = (t >= 0) & (t < duration_us)
            columns.append((t[inside], x[hit][inside], y[hit][inside], np.full(inside.sum(), on)))
    t, x, y, on = (np.concatenate(column) for column in zip(*columns, strict=True))
    return t.astype(np.int64), x, y, on


def noise_events(
    rate_hz: float, duration_us: int, sensor: SensorSize, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Poisson noise, the same rate in every pixel."""
    count = rng.poisson(rate_hz * 1e-6 * duration_us * sensor.width_px * sensor.height_px)
    return (
        rng.integers(0, duration_us, count),
        rng.integers(0, sensor.width_px, count),
        rng.integers(0, sensor.height_px, count),
        rng.random(count) < 0.5,
    )


def _make_scene(
    *flights: Flight,
    noise_hz: float = 1.0,
    duration_us: int = 100_000,
    sensor: SensorSize = SensorSize(320, 240),  # noqa: B008 - frozen
    seed: int = 0,
) -> Scene:
    rng = np.random.default_rng(seed)
    parts = [noise_events(noise_hz, duration_us, sensor, rng)]
    parts += [edge_events(flight, duration_us, sensor, rng) for flight in flights]
    t, x, y, on = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(t, kind="stable")
    return Scene(Events.from_columns(t[order], x[order], y[order], on[order], sensor), duration_us)


@pytest.fixture(scope="session")
def make_scene() -> Callable[..., Scene]:
    """Makes a scene from any number of flights over noise."""
    return _make_scene


@pytest.fixture(scope="session")
def make_flight() -> type[Flight]:
    """The class of flights."""
    return Flight


def _add_frames(windows: Sequence[Window], flight: Flight | None, seed: int = 0) -> list[Window]:
    """The windows, each with a picture of the disc in its middle, exposed for half of it; of noise without a flight."""
    rng, found = np.random.default_rng(seed), []
    for window in windows:
        t_us, sensor = (window.start_us + window.end_us) // 2, window.events.sensor
        image = rng.integers(50, 70, (sensor.height_px, sensor.width_px, 3), np.uint8)
        if flight is not None:
            (u, v), ms = flight.centre(t_us), (window.end_us - window.start_us) / 2000
            image = draw_streak(image, BallStreak(
                x_px=u + 0.5, y_px=v + 0.5, r_px=flight.r_px, light=(0.8, 0.4, 0.08),
                motion_px=(ms * flight.du_px_per_ms, ms * flight.dv_px_per_ms),
            ))  # fmt: skip
        image.flags.writeable = False
        frame = CameraFrame(t_us, (window.end_us - window.start_us) // 2, image)
        found.append(dataclasses.replace(window, frame=frame))
    return found


@pytest.fixture(scope="session")
def add_frames() -> Callable[..., list[Window]]:
    """Gives windows pictures of a flight."""
    return _add_frames


@pytest.fixture(scope="session")
def circles() -> Callable[..., LabelledPictures]:
    """Draws pictures with a disc each."""
    return draw_circles


@pytest.fixture(scope="session")
def small_yolo() -> YoloWeights:
    """A small network that finds drawn discs; tests/fixtures/make_yolo_discs.py says how it was trained."""
    return load_weights(Path(__file__).parents[2] / "fixtures" / "yolo-discs.safetensors")
