"""The bench of the planet: its truth, on a drawn planet with moons, and what it refuses."""

import numpy as np
import pytest

from benchmarks.detection import bench_planet as bench
from core.errors import CommandError
from core.events import Events, SensorSize
from tests.drawn_glow import events_of_light

SENSOR = SensorSize(320, 280)


def draw_planet(duration_us: int) -> tuple[Events, np.ndarray]:
    """Events of a planet and a moon that swing about (160, 140) in both directions; the moon is at (+60, -50)."""
    rows, columns = np.mgrid[: SENSOR.height_px, : SENSOR.width_px]

    def centre(t_us: int) -> tuple[float, float]:
        phase = 2e-6 * np.pi * t_us
        return 160.0 + 6.0 * np.sin(7 * phase), 140.0 + 6.0 * np.sin(5 * phase)

    def light(t_us: int) -> np.ndarray:
        u, v = centre(t_us)
        planet = 4.0 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / 200.0)
        return planet + 2.0 * np.exp(-((columns - u - 60.0) ** 2 + (rows - v + 50.0) ** 2) / 4.0)

    times_us = range(0, duration_us, 500)
    return events_of_light(light, times_us, SENSOR, seed=0), np.array([(t_us, *centre(t_us)) for t_us in times_us])


def test_a_moon_is_followed_and_the_middle_of_the_light_is_the_planets_centre() -> None:
    events, centres = draw_planet(300_000)
    t_us = np.arange(10_000, 290_000, bench.STEP_US)
    moon = bench.follow_moon(events, t_us, (224.0, 94.0))
    centre = np.column_stack([np.interp(t_us, centres[:, 0], centres[:, axis]) for axis in (1, 2)])
    assert np.abs(moon - centre - (60.0, -50.0)).max() < 1.5
    offset = bench.centre_of_light(events, bench.PlanetTruth(t_us, moon))
    assert offset == pytest.approx([-60.0, 50.0], abs=0.7)


def test_without_its_recording_it_says_where_that_is_from() -> None:
    with pytest.raises(CommandError, match="faery"):
        bench.run(lambda share: None)
    with pytest.raises(CommandError, match="too short"):
        bench.planet_truth(draw_planet(2000)[0])
