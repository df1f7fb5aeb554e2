import numpy as np
import pytest

from core.cameras import Camera
from core.events import SensorSize
from core.geometry import look_at
from core.simulation.flights import ParabolicPath


@pytest.fixture(scope="session")
def camera() -> Camera:
    """96x72 pixels that look at the middle of the table from 1.5 m: a ball there has a radius of 8 px."""
    K = np.array([[600.0, 0, 47.5], [0, 600.0, 35.5], [0, 0, 1]])
    return Camera(SensorSize(96, 72), K, np.zeros(5), look_at((-0.2, -1.3, 0.9), (0.0, 0.0, 0.2)))


@pytest.fixture(scope="session")
def crossing() -> ParabolicPath:
    """A ball that crosses the picture at 4 m/s, in it from the start."""
    start, velocity = np.array([[0.88, 0.0, 0.2]]), np.array([[-4.0, 0.0, 0.0]])
    return ParabolicPath(np.array([-0.2]), start, velocity, np.zeros((1, 3)), 1.0, 0.0)


@pytest.fixture(scope="session")
def gone() -> ParabolicPath:
    """No ball."""
    return ParabolicPath(
        np.array([-1.0]), np.array([[0.0, 50.0, 0.1]]), np.array([[0.0, 1.0, 0.0]]), np.zeros((1, 3)), -0.5
    )
