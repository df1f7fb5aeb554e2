"""Does the fast path answer exactly as the readable one? Random inputs that look for trouble, and live windows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from benchmarks.detection.bench_detection import TOLERANCE_PX, distance_px
from core.detection import Detector, DetectorConfig, FastDetector, ReferenceDetector, paper_config
from core.detection.fast.cluster import grid_labels
from core.detection.stages.cluster import ClusterConfig, cluster_labels
from core.detection.stages.denoise import DenoiseConfig
from core.detection.stages.flicker import FlickerConfig
from core.detection.stages.geometry import GeometryConfig
from core.detection.stages.hot_pixels import HotPixelConfig
from core.detection.stages.localise import LocaliseConfig
from core.detection.stages.polarity import PolarityConfig
from core.detection.stages.roi import RoiConfig
from core.events import Events, SensorSize, Window

WINDOW_US = 2000


@dataclass(frozen=True, slots=True)
class ExactnessCount:
    """How two detectors compared over the same windows."""

    windows: int
    detections: int
    """Of the first."""
    differing: int
    """Windows in which one found a ball and the other did not, or they counted different circles, or more than a
    thousandth of a pixel lies between them."""
    largest_px: float
    """Largest difference of u, v or r where both found one."""

    def __add__(self, other: ExactnessCount) -> ExactnessCount:
        return ExactnessCount(
            self.windows + other.windows,
            self.detections + other.detections,
            self.differing + other.differing,
            max(self.largest_px, other.largest_px),
        )


NOTHING_COMPARED = ExactnessCount(0, 0, 0, 0.0)


def compare_detectors(one: Detector, other: Detector, windows: Iterable[Window]) -> ExactnessCount:
    """Both on the same windows, each with its own live state."""
    total = NOTHING_COMPARED
    for window in windows:
        a, b = one.step(window), other.step(window)
        off_px = distance_px(a, b)
        differs = one.extra_circles != other.extra_circles or off_px > TOLERANCE_PX
        total += ExactnessCount(1, int(a is not None), int(differs), off_px if np.isfinite(off_px) else 0.0)
    return total


def compare_random(streams: int, windows: int, rng: np.random.Generator) -> ExactnessCount:
    """Reference and fast path on `streams` random streams of `windows` windows, each with a random config."""
    total = NOTHING_COMPARED
    for _ in range(streams):
        config = random_config(rng)
        total += compare_detectors(ReferenceDetector(config), FastDetector(config), random_windows(windows, rng))
    return total


def compare_labels(sets: int, rng: np.random.Generator) -> int:
    """How many of so many random sets of events scikit-learn and the grid label differently."""
    differing = 0
    for _ in range(sets):
        sensor = SensorSize(int(rng.integers(1, rng.choice([60, 60, 200]))), int(rng.integers(1, 60)))
        count = int(rng.integers(0, rng.choice([3, 400, 400, 2000])))
        events = Events.from_columns(
            np.sort(rng.integers(0, 3000, count)),
            rng.integers(0, sensor.width_px, count),
            rng.integers(0, sensor.height_px, count),
            rng.random(count) < 0.5,
            sensor,
        )
        config = ClusterConfig(
            eps_px=float(rng.choice([1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 12])),
            min_samples=int(rng.integers(1, 14)),
            time_scale_px_per_ms=float(rng.choice([0, 0, 0.5, 2, 5.5])),
        )
        differing += not np.array_equal(cluster_labels(events, config), grid_labels(events, config))
    return differing


def random_config(rng: np.random.Generator) -> DetectorConfig:
    """A config of any combination of stages, loose enough that much passes."""
    config = DetectorConfig(
        roi=RoiConfig(enabled=bool(rng.random() < 0.8), roi_expand_px=float(rng.choice([12.0, 25.5, 50.0]))),
        hot_pixels=HotPixelConfig(enabled=bool(rng.random() < 0.2), persistence_ms=20.0),
        flicker=FlickerConfig(enabled=bool(rng.random() < 0.2), cycles_min=1),
        denoise=DenoiseConfig(kernel_px=int(rng.choice([1, 3, 3, 3, 5, 7, 9]))),
        cluster=ClusterConfig(
            eps_px=float(rng.choice([1.0, 2.0, 3.0, 4.5])),
            min_samples=int(rng.integers(1, 12)),
            time_scale_px_per_ms=float(rng.choice([0.0, 0.0, 1.5])),
            size_min=int(rng.integers(1, 30)),
        ),
        polarity=PolarityConfig(
            leading_polarity=str(rng.choice(["auto", "auto", "on", "off"])),  # pyright: ignore[reportArgumentType]
            memory_ms=float(rng.choice([0.0, 40.0, 40.0])),
            outlier_radius_px=float(rng.choice([8.0, 28.0])),
        ),
        geometry=GeometryConfig(circularity_min=float(rng.choice([0.0, 0.4, 0.65])), solidity_min=0.1),
        localise=LocaliseConfig(
            radius_min_px=float(rng.choice([1.0, 4.0])), radius_max_px=float(rng.choice([9.0, 24]))
        ),
    )
    return paper_config(config) if rng.random() < 0.2 else config


def random_windows(count: int, rng: np.random.Generator) -> list[Window]:
    """Consecutive windows of a small sensor, often a single row or column: arcs that drift over the border, noise,
    several events on a pixel, several at one time, windows with nothing at all or a few events, and some that fill the
    sensor several times over.
    """
    sensor = SensorSize(*(int(rng.choice([1, 9, 40, 63, 64, 65, 90, 127, 128, 130, 130, 193])) for _ in range(2)))
    place, speed = rng.uniform(0, 1, 2) * (sensor.width_px, sensor.height_px), rng.uniform(-4, 4, 2)
    radius = rng.uniform(3, 14)
    windows = []
    for number in range(count):
        place = place + speed
        arcs, noise = int(rng.integers(0, 400)), int(rng.integers(0, 60))
        if rng.random() < 0.15:
            arcs, noise = int(rng.integers(0, 3)), int(rng.integers(0, 3))
        elif rng.random() < 0.03:
            noise = min(8000, int(rng.uniform(0.3, 4) * sensor.width_px * sensor.height_px))
        angle = rng.uniform(-np.pi, np.pi, arcs)
        distance = radius - rng.uniform(0, 4, arcs)
        x = np.concatenate([place[0] + distance * np.cos(angle), rng.uniform(0, sensor.width_px, noise)])
        y = np.concatenate([place[1] + distance * np.sin(angle), rng.uniform(0, sensor.height_px, noise)])
        leads = np.concatenate([np.cos(angle) * speed[0] + np.sin(angle) * speed[1] > 0, rng.random(noise) < 0.5])
        x, y = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        seen = (x >= 0) & (x < sensor.width_px) & (y >= 0) & (y < sensor.height_px) & (rng.random() < 0.9)
        t = number * WINDOW_US + np.sort(rng.integers(0, WINDOW_US, int(seen.sum())) // 50 * 50)
        events = Events.from_columns(t, x[seen], y[seen], leads[seen], sensor)
        windows.append(Window(events, number * WINDOW_US, (number + 1) * WINDOW_US))
    return windows
