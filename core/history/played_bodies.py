"""Persons of a simulated scene at any time, computed from the scene's name and the seed.

So the live link sends no poses, and neither does a recording keep any. Where scene or seed is not known, or a file was
made by another version, whose people would stand elsewhere, nobody is drawn.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from core.config import config_from_mapping
from core.errors import RallyscopeError
from core.history.rally_picture import People
from core.history.recorded_rally import SCENES_SEEN
from core.physics.config import PhysicsConfig
from core.recordings import BallTruth, Recording
from core.recordings.reader import FileRecording
from core.simulation.bodies import MovingBodies, make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.flights import FlightSeries, LaunchConfig
from core.simulation.scenes.scene import SCENES, SceneConfig

logger = logging.getLogger(__name__)

AGREES_M: Final = 1e-3
"""The flights drawn again must be those of the recording."""
COMPARED: Final = 50
"""Times at which they are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class ScenePart:
    """From some time on these bodies move, until the next part of the time."""

    start_us: int
    zero_us: int
    """Their own clock at time 0."""
    bodies: MovingBodies | None


@dataclass(frozen=True, slots=True, eq=False)
class PlayedBodies:
    """Persons over time."""

    parts_of_time: tuple[ScenePart, ...] = ()
    """In order of time."""

    def at(self, t_us: int) -> People | None:
        """All parts of all bodies at a time; None if nobody is there."""
        there = [one for one in self.parts_of_time if one.start_us <= t_us]
        if not there or there[-1].bodies is None:
            return None
        bodies = there[-1].bodies
        return People(bodies.parts, bodies.ends(np.array([(t_us + there[-1].zero_us) * 1e-6]))[0])

    def then(self, start_us: int, scene: str, seed: int, zero_us: int = 0) -> PlayedBodies:
        """Copy with these bodies until `start_us`, then those of a live scene."""
        bodies = make_actors(SCENES[scene].cast, seed) if scene in SCENES else None
        return PlayedBodies((*self.parts_of_time, ScenePart(start_us, zero_us, bodies)))


def recorded_bodies(recording: Recording) -> PlayedBodies:
    """Persons of a recording, from its config, or for a recorded live rally from its scenes."""
    if not isinstance(recording, FileRecording):
        return PlayedBodies()
    rows = recording.read_rows(SCENES_SEEN)
    if rows is not None:
        return _of_live(rows)
    if recording.config is None or recording.seed is None or "scene" not in recording.config:
        return PlayedBodies()
    try:
        bodies = _of_simulated(recording.config, recording.seed, recording.ball)
    except (RallyscopeError, ValueError, TypeError, KeyError) as error:
        logger.info("who is in the recording cannot be told from its config: %s", error)
        bodies = None
    return PlayedBodies((ScenePart(0, 0, bodies),))


def _of_live(rows: Mapping[str, np.ndarray]) -> PlayedBodies:
    found = PlayedBodies()
    for t_us, zero_us, seed, name in zip(rows["t_us"], rows["zero_us"], rows["seed"], rows["name"], strict=True):
        found = found.then(int(t_us), bytes(name).decode("ascii", "replace"), int(seed), int(zero_us))
    return found


def _of_simulated(config: Mapping[str, object], seed: int, ball: BallTruth | None) -> MovingBodies | None:
    scene = config_from_mapping(SceneConfig, config["scene"], where="the recording's config [scene]")
    if scene.cast != "rally":
        return make_actors(scene.cast, seed)
    serves, physics = config["serves"], config["physics"]
    assert isinstance(serves, Sequence)
    launches = [config_from_mapping(LaunchConfig, one, where="the recording's config [serves]") for one in serves]
    known = config_from_mapping(PhysicsConfig, physics, where="the recording's config [physics]")
    flights, strokes = draw_flights(scene, launches, np.random.default_rng(seed), known)
    return make_actors(scene.cast, seed, strokes) if ball is not None and _same_flights(flights, ball) else None


def _same_flights(flights: FlightSeries, ball: BallTruth) -> bool:
    seen = np.flatnonzero(ball.visible & np.isfinite(ball.p_world_m).all(axis=1))
    if not len(seen):
        return False
    rows = seen[np.unique(np.linspace(0, len(seen) - 1, COMPARED).astype(np.int64))]
    error_m = np.abs(flights.at(ball.t_us[rows] * 1e-6).p_world_m - ball.p_world_m[rows])
    return bool(np.nanmax(error_m) < AGREES_M)
