import numpy as np
import pytest

from core.cameras import Camera
from core.events import SensorSize
from core.geometry import look_at
from core.simulation import SensorConfig
from core.simulation.flights import ParabolicPath

QUIET = SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0)
"""Only what the light does."""


@pytest.fixture(scope="session")
def small_camera() -> Camera:
    """96x72 pixels that look at the middle of the table from 1.5 m: a ball there has a radius of 8 px."""
    K = np.array([[600.0, 0, 47.5], [0, 600.0, 35.5], [0, 0, 1]])
    return Camera(SensorSize(96, 72), K, np.zeros(5), look_at((-0.2, -1.3, 0.9), (0.0, 0.0, 0.2)))


@pytest.fixture(scope="session")
def crossing() -> ParabolicPath:
    """A ball that crosses the small camera's picture at 4 m/s, in it from the start and at the end."""
    position, velocity = np.array([[0.08, 0.0, 0.2]]), np.array([[-4.0, 0.0, 0.0]])
    return ParabolicPath(
        np.array([-0.2]), position - 4.0 * 0.2 * np.array([[-1.0, 0, 0]]), velocity, np.zeros((1, 3)), 1.0, 0.0
    )
