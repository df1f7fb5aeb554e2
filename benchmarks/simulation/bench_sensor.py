"""The event camera against the sensor by brute force: how many events, and when, in clips of every scene.

A clip is a picture of 160x120 pixels, with the focal length of the presets, that looks at what moves from where a
camera of a placement stands. The event camera looks at few pixels as seldom as it can; the dense simulation at every
pixel every 20 us. Counts must agree within 10 %, the Kolmogorov-Smirnov distance of the time stamps be 0.05 at most.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.machine import describe_machine, machine_words
from benchmarks.partial_rows import report_rows_to
from benchmarks.simulation.dense_sensor import DENSE_STEP_US, compare_events, dense_events
from core.cameras import Camera
from core.cameras.presets import DISTORTION, FOCAL_PX, PLACEMENTS
from core.events import SensorSize
from core.geometry import look_at
from core.simulation.bodies import MovingBodies, make_actors
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.event_cameras.event_camera import EventCamera
from core.simulation.flights.ball_path import BallPath
from core.simulation.flights.serve import LaunchConfig
from core.simulation.scenes.racket_shape import RacketPoses
from core.simulation.scenes.scene import scene_named
from core.simulation.sensor.sensor import SensorConfig
from core.text.markdown_table import markdown_table

REPORT: Final = Path("docs/measured/sensor-report.md")
SEED: Final = 11
SIZE: Final = SensorSize(160, 120)
COUNT_BOUND, KS_BOUND = 0.10, 0.05
BLADE: Final = -1
"""The last part of the cast is a racket's blade, or the whole head."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorClip:
    """What is looked at, when, and from where."""

    name: str
    scene: str = "ball"
    placement: str = "side"
    part: int | None = None
    """Part of the cast that is looked at; None looks at the ball."""
    start_us: int
    duration_us: int = 40_000
    speed_mps: float = 5.0
    changes: Mapping[str, float] = field(default_factory=dict)
    """Of the scene's settings."""
    racket: bool = False
    """The robot's racket moves through the picture too."""


CLIPS: Final = (
    SensorClip(name="ball in flight", start_us=250_000),
    SensorClip(name="ball and its shadow at the bounce, 9 m/s", start_us=150_000, speed_mps=9.0),
    SensorClip(name="slow ball, 3 m/s", start_us=300_000, speed_mps=3.0),
    SensorClip(name="dark ball", scene="dark", start_us=250_000),
    SensorClip(name="low contrast", scene="low-contrast", start_us=250_000),
    SensorClip(name="bright walls", placement="behind", start_us=150_000, changes={"wall": 0.7}),
    SensorClip(name="flickering light", start_us=250_000, changes={"flicker": 0.2}),
    SensorClip(name="ball and the robot's racket", start_us=250_000, racket=True),
    SensorClip(name="person: trunk", scene="person", placement="behind", part=2, start_us=500_000),
    SensorClip(
        name="person: arm and racket in a swing", scene="person", placement="behind", part=BLADE, start_us=1_000_000
    ),
    SensorClip(name="ball before a person", scene="person", placement="behind", start_us=80_000),
    SensorClip(name="two persons: who walks by", scene="two-persons", part=18, start_us=500_000),
    SensorClip(name="two persons: legs behind the table's edge", scene="two-persons", part=25, start_us=700_000),
    SensorClip(
        name="rally: the ball is struck", scene="rally", placement="behind", start_us=1_950_000, duration_us=60_000
    ),
    SensorClip(name="rally: player's arm", scene="rally", placement="behind", part=6, start_us=1_900_000),
    SensorClip(name="head", scene="head", part=0, start_us=300_000),
)


@dataclass(slots=True, eq=False)
class _Sliding:
    """A racket that comes across the ball's way."""

    p_world_m: NDArray[np.float64]
    start_s: float
    radius_m: float = 0.08
    thickness_m: float = 0.10

    def at(self, t_s: ArrayLike) -> RacketPoses:
        since_s = np.atleast_1d(np.asarray(t_s, np.float64)) - self.start_s
        p = self.p_world_m + np.outer(since_s, [0.3, 1.2, 0.4])
        normal = np.array([0.95, 0.1, 0.3]) / np.linalg.norm([0.95, 0.1, 0.3])
        return RacketPoses(p, np.tile(normal, (len(since_s), 1)))


def run(progress: Callable[[float], None], *, report: Path = REPORT) -> dict[str, object]:
    """A row per clip, the report's place, and the machine."""
    rows: list[dict[str, object]] = []
    for clip in CLIPS:
        rows.append(measure_sensor(clip))
        report_rows_to(progress, rows[-1:], len(rows) / len(CLIPS))
    machine = describe_machine("numba", "numpy", clock="none: counts and times of simulated events")
    report.write_text(write_sensor_report(rows, machine), encoding="utf-8")
    return {"rows": rows, "report": str(report), "machine": machine}


def measure_sensor(clip: SensorClip, size: SensorSize = SIZE) -> dict[str, object]:
    """Measure one clip: one row of the report."""
    scene = dataclasses.replace(scene_named(clip.scene), **clip.changes)
    balls = [LaunchConfig(speed_mps=clip.speed_mps)] * 3
    path, strokes = draw_flights(scene, balls, np.random.default_rng(SEED))
    bodies = make_actors(scene.cast, SEED, strokes)
    end_us = clip.start_us + clip.duration_us
    target = _target(clip, path, bodies, 0.5e-6 * (clip.start_us + end_us))
    camera = _camera(clip, target, size)
    racket = _Sliding(target - [0.1, 0.05, 0.0], 1e-6 * clip.start_us) if clip.racket else None
    config = SensorConfig(noise_hz=0.0, hot_pixels_per_million=0.0)
    rig = EventCamera(camera, scene, config, np.random.default_rng(SEED), bodies, clip.start_us)
    events = rig.advance(path, end_us, racket)
    dense = dense_events(
        camera, scene, config, path, end_us, start_us=clip.start_us, seed=SEED, bodies=bodies, racket=racket
    )
    row: dict[str, object] = {"clip": clip.name, "dense": len(dense.t_us)}
    good = True
    for name, found in compare_events(events, dense).items():
        row |= {f"{name}_ratio": found.ratio, f"{name}_ks": found.ks}
        good = good and abs(found.ratio - 1) <= COUNT_BOUND and found.ks <= KS_BOUND
    return row | {"within": good}


def write_sensor_report(rows: list[dict[str, object]], machine: dict[str, object]) -> str:
    """The report as Markdown."""
    lines = [
        "# The sensor model against brute force",
        "",
        "Made by `rallyscope bench sensor`. Each clip is 160x120 pixels at the focal length of the presets and 40 to",
        "60 ms long, without noise, with the mismatch of thresholds. The event camera of",
        f"[sensor-model.md](../how/sensor-model.md) meets a simulation of every pixel every {DENSE_STEP_US} us in",
        "plain numpy (`benchmarks/simulation/dense_sensor.py`). Both share what light a pixel sees; neither meets a"
        " real sensor here.",
        "",
        "Ratio: events of the event camera per event of the dense simulation. KS: Kolmogorov-Smirnov distance of their",
        f"time stamps. Bounds: {COUNT_BOUND:.0%} and {KS_BOUND}.",
        "",
        markdown_table(
            ("clip", "events (dense)", "ON ratio", "ON KS", "OFF ratio", "OFF KS", "within the bounds"),
            [[*(row | {"within": "yes" if row["within"] else "**no**"}).values()] for row in rows],
            ("", ",", ".3f", ".4f", ".3f", ".4f"),
        ),
    ]
    within = sum(bool(row["within"]) for row in rows)
    lines += [f"{within} of {len(rows)} clips are within the bounds. Seed {SEED}; {machine_words(machine)}.", ""]
    return "\n".join(lines)


def _target(clip: SensorClip, path: BallPath, bodies: MovingBodies | None, t_s: float) -> NDArray[np.float64]:
    """Where the clip looks: at the ball, or at a part of the cast."""
    if clip.part is None:
        return path.at([t_s]).p_world_m[0]
    assert bodies is not None
    return bodies.ends(np.array([t_s]))[0, clip.part].mean(axis=0)


def _camera(clip: SensorClip, target: NDArray[np.float64], size: SensorSize) -> Camera:
    x, y, z = PLACEMENTS[clip.placement][0]
    K = np.array([[FOCAL_PX, 0, (size.width_px - 1) / 2], [0, FOCAL_PX, (size.height_px - 1) / 2], [0, 0, 1]])
    return Camera(size, K, np.array(DISTORTION), look_at((x, y, z), tuple(target)))
