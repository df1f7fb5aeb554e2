"""Scenes and sensors drawn at random, to measure detectors on what no threshold was found with.

A row names what is hard; a number draws everything else: the placement, the speed, spin and direction of the ball, and
where it is asked for the sensor, the brightness of ball and room. Development and scores draw from disjoint numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from core.cameras.presets import PLACEMENTS
from core.physics.config import Profile, physics_profile
from core.simulation import LaunchConfig, SceneConfig, SensorConfig, StereoConfig, scene_named

Row = Literal["ball", "clutter", "crossing", "contrast", "slow"]
ROW_SCENES: Final[dict[Row, tuple[str, ...]]] = {
    "ball": ("ball",),
    "clutter": ("person", "head"),
    "crossing": ("two-persons", "rally"),
    "contrast": ("dark", "low-contrast"),
    "slow": ("ball",),
}
"""What each row of the table of goals is simulated with."""
NOISES_HZ: Final = (0.1, 1.0, 5.0)
SPEEDS_MPS: Final = (5.0, 9.0)
SLOW_MPS: Final = 3.0
SCORED_FROM: Final = 100_000
"""Numbers below are for development, from here on for scores: no threshold is found on them."""


@dataclass(frozen=True, slots=True)
class DrawnFlight:
    """One serve, or rally, to simulate."""

    row: Row
    number: int
    placement: str
    stereo: StereoConfig
    launch: LaunchConfig
    physics: Profile


def draw_flight(row: Row, number: int, *, any_sensor: bool) -> DrawnFlight:
    """The flight of a row and number; with `any_sensor` sensor and room are drawn too, else they are the standard ones.

    The same row and number fly the same ball past the same cameras, whatever the sensor.
    """
    rng = np.random.default_rng([number, *row.encode()])
    scene_name = str(rng.choice(ROW_SCENES[row]))
    names = [name for name in PLACEMENTS if scene_name != "rally" or name != "behind"]  # a player would stand before it
    placement = str(rng.choice(names))
    speed_mps = SLOW_MPS if row == "slow" else float(rng.uniform(*SPEEDS_MPS))
    noise_hz = float(rng.choice(NOISES_HZ)) if row == "ball" else NOISES_HZ[0]
    physics: Profile = "real" if rng.random() < 0.5 and scene_name != "rally" else "paper"  # whose balls have no air
    launch = LaunchConfig(
        speed_mps=speed_mps, yaw_spread_deg=2.0, spin_spread_radps=60.0 if physics_profile(physics).has_air else 0.0
    )
    scene, sensor = scene_named(scene_name), SensorConfig(noise_hz=noise_hz)
    if any_sensor:
        scene, sensor = draw_room(scene, rng), draw_sensor(rng)
    return DrawnFlight(row, number, placement, StereoConfig(scene=scene, sensor=sensor), launch, physics)


def draw_sensor(rng: np.random.Generator) -> SensorConfig:
    """A sensor of any make: thresholds, their mismatch, speed in good or bad light, noise, hot pixels."""
    threshold = float(np.exp(rng.uniform(np.log(0.1), np.log(0.4))))
    uneven = float(rng.uniform(-0.15, 0.15))
    return SensorConfig(
        on_threshold=threshold * (1.0 + uneven),
        off_threshold=threshold * (1.0 - uneven),
        threshold_mismatch=float(rng.uniform(0.03, 0.15)),
        refractory_us=int(np.exp(rng.uniform(0.0, np.log(200.0)))),
        photoreceptor_us=float(np.exp(rng.uniform(np.log(50.0), np.log(800.0)))),
        noise_hz=float(np.exp(rng.uniform(np.log(0.1), np.log(5.0)))),
        hot_pixels_per_million=float(rng.uniform(0.0, 250.0)),
    )


def draw_room(scene: SceneConfig, rng: np.random.Generator) -> SceneConfig:
    """The scene in other light, with another ball and other walls, about as hard for its contrast."""
    brighter = float(np.exp(rng.uniform(np.log(0.75), np.log(1.3))))

    def changed(reflectance: float) -> float:
        return float(np.clip(reflectance * brighter * np.exp(rng.uniform(-0.15, 0.15)), 0.02, 0.95))

    return replace(
        scene,
        ball=float(np.clip(scene.ball * np.exp(rng.uniform(-0.15, 0.1)), 0.02, 0.95)),
        table=changed(scene.table),
        floor=changed(scene.floor),
        wall=changed(scene.wall),
        ambient=float(rng.uniform(0.4, 0.8)),
        edge_px=float(rng.uniform(1.2, 2.4)),
    )
