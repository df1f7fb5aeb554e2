"""Who stands in the 3D scene is who the cameras saw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.config import config_to_mapping
from core.events import SensorSize
from core.history.played_bodies import PlayedBodies, recorded_bodies
from core.history.recorded_rally import SCENES_SEEN, scene_rows
from core.live.worlds.world import SimulatedWorld, WorldConfig
from core.physics.config import PhysicsConfig
from core.recordings import RecordingWriter, open_recording
from core.simulation import StereoConfig, ball_truth, simulate_recording, truth_times
from core.simulation.bodies import make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.flights import LaunchConfig
from core.simulation.scenes.scene import SCENES

SMALL = SensorSize(64, 48)
CAMERAS = stereo_preset("side", SMALL)
RALLY = {**config_to_mapping(StereoConfig(scene=SCENES["rally"])), "serves": [config_to_mapping(LaunchConfig())]}


def write(path: Path, *, seed: int, config: dict[str, object], flights_seed: int | None = None) -> Path:
    """A recording without events, whose ball flies as drawn for a seed."""
    with RecordingWriter(path, dict.fromkeys(CAMERAS, SMALL), seed=seed, config=config) as writer:
        if flights_seed is not None:
            flights, _ = draw_flights(SCENES["rally"], [LaunchConfig()], np.random.default_rng(flights_seed))
            writer.write_ball(ball_truth(flights, truth_times(flights, 0, 3_000_000)))
        writer.extend_duration(3_000_000)
    return path


def test_the_players_of_a_simulated_recording_are_those_that_its_cameras_saw(tmp_path) -> None:
    config, chunks = StereoConfig(scene=SCENES["two-persons"]), iter(range(1000))
    simulate_recording(
        tmp_path / "a.h5", config, CAMERAS, [LaunchConfig()], seed=4, cancelled=lambda: next(chunks) >= 2
    )
    with open_recording(tmp_path / "a.h5") as recording:
        found = recorded_bodies(recording).at(15_000)
    bodies = make_actors("two-persons", 4)
    assert found is not None and bodies is not None
    np.testing.assert_array_equal(found.ends_m, bodies.ends(np.array([0.015]))[0])
    np.testing.assert_array_equal(found.parts, bodies.parts)


def test_rally_players_meet_the_recorded_ball(tmp_path) -> None:
    settings = {**RALLY, "physics": config_to_mapping(PhysicsConfig())}
    path = write(tmp_path / "rally.h5", seed=6, config=settings, flights_seed=6)
    _, strokes = draw_flights(SCENES["rally"], [LaunchConfig()], np.random.default_rng(6))
    with open_recording(path) as recording:
        bodies = recorded_bodies(recording)
    for stroke in strokes:
        people = bodies.at(round(stroke.t_s * 1e6))
        assert people is not None
        assert np.linalg.norm(people.ends_m - stroke.p_world_m, axis=-1).min() < 0.005


def test_players_of_other_flights_are_not_drawn(tmp_path) -> None:
    settings = {**RALLY, "physics": config_to_mapping(PhysicsConfig())}
    with open_recording(write(tmp_path / "other.h5", seed=6, config=settings, flights_seed=7)) as recording:
        assert recorded_bodies(recording).at(1_500_000) is None


@pytest.mark.parametrize("config", [{}, {"scene": "mine"}, {"scene": {"cast": "somebody"}}, RALLY])
def test_a_config_that_does_not_tell_draws_nobody(config, tmp_path) -> None:
    with open_recording(write(tmp_path / "b.h5", seed=1, config=config)) as recording:
        assert recorded_bodies(recording).at(1_000) is None


def test_a_recorded_live_rally_tells_its_scenes_one_after_the_other(tmp_path) -> None:
    with RecordingWriter(tmp_path / "live.h5", dict.fromkeys(CAMERAS, SMALL), config={"source": "live"}) as writer:
        writer.append_rows(SCENES_SEEN, scene_rows(0, "ball", 9, 5_000_000))
        writer.append_rows(SCENES_SEEN, scene_rows(200_000, "person", 9, 5_000_000))
        writer.append_rows(SCENES_SEEN, scene_rows(400_000, "custom", 9, 5_000_000))
        writer.extend_duration(600_000)
    with open_recording(tmp_path / "live.h5") as recording:
        bodies = recorded_bodies(recording)
    person = make_actors("person", 9)
    assert person is not None and bodies.at(100_000) is None and bodies.at(500_000) is None
    found = bodies.at(300_000)
    assert found is not None
    np.testing.assert_array_equal(found.ends_m, person.ends(np.array([5.3]))[0])


def test_live_people_are_those_of_the_simulated_world(tmp_path) -> None:
    world = SimulatedWorld(WorldConfig(stereo=StereoConfig(scene=SCENES["person"])), CAMERAS, 12)
    try:
        found = PlayedBodies().then(0, "person", world.seed).at(70_000)
        assert found is not None and world.bodies is not None
        np.testing.assert_array_equal(found.ends_m, world.bodies.ends(np.array([0.07]))[0])
    finally:
        world.close()
    assert PlayedBodies().at(0) is None and PlayedBodies().then(0, "no such scene", 1).at(5) is None
