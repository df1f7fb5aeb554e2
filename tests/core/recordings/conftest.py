"""Events and recordings for the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.events import Events, SensorSize

SHARED = Path(__file__).parents[4] / "shared" / "data" / "events"


def random_events(count: int, *, seed: int, duration_us: int, sensor: SensorSize) -> Events:
    """Uniformly random events; the first lies at 0 us and the last at `duration_us` - 1."""
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.integers(0, duration_us, count))
    if count:
        t_us[0], t_us[-1] = 0, duration_us - 1
    return Events.from_columns(
        t_us,
        rng.integers(0, sensor.width_px, count),
        rng.integers(0, sensor.height_px, count),
        rng.integers(0, 2, count).astype(bool),
        sensor,
    )


@pytest.fixture
def make_events():
    """The function `random_events`."""
    return random_events


@pytest.fixture(scope="session")
def shared_events() -> Path:
    """The folder of real event files."""
    if not SHARED.is_dir():
        pytest.skip(f"the shared event files are not here: {SHARED}")
    return SHARED
