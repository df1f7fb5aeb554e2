"""The simulated world: what the cameras look at may change while it runs."""

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.events import SensorSize
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.simulation import SensorConfig, StereoConfig, scene_named
from core.simulation.sensor.readout import ReadoutCounts

pytestmark = pytest.mark.numeric
QUIET = StereoConfig(sensor=SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0))


def events_of(world: SimulatedWorld, blocks: int) -> list[int]:
    return [sum(len(events.t_us) for events in world.advance().events.values()) for _ in range(blocks)]


def test_another_scene_begins_without_a_flash_and_its_people_are_in_the_truth() -> None:
    world = SimulatedWorld(WorldConfig(stereo=QUIET), stereo_preset("behind", SensorSize(640, 600)), seed=3)
    try:
        assert events_of(world, 3) == [0, 0, 0] and world.bodies is None
        world.set_scene(scene_named("person"))
        among = events_of(world, 20)
        # A flash would be events of all the picture in the first block: the person was there for long.
        assert among[0] < 3 * np.median(among) and sum(among) > 2000
        assert world.bodies is not None and world.now_us == 230_000
        passed = {name: counts.passed for name, counts in world.readout.items()}
        world.set_scene(scene_named("ball"))
        assert events_of(world, 3) == [0, 0, 0]
        assert {name: counts.passed for name, counts in world.readout.items()} == passed
    finally:
        world.close()


def test_counts_of_two_readouts_add_up() -> None:
    both = ReadoutCounts(10, 2, 1, 50).plus(ReadoutCounts(5, 1, 0, 80))
    assert both == ReadoutCounts(15, 3, 1, 80)
