"""The sensor by brute force: every pixel of the picture, every 20 us, in plain numpy. Slow, and nothing to get wrong.

It shares with the event camera only what the light in a pixel is. Which pixels are looked at and when, the events
between two looks, rests, refractory times and the order of it all are its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp

from core.cameras import Camera
from core.events import Events
from core.simulation.bodies.parts import MovingBodies
from core.simulation.flights import BallPath
from core.simulation.scenes.background import make_background
from core.simulation.scenes.ball_view import ball_shading_rows
from core.simulation.scenes.block_view import flicker_log_light
from core.simulation.scenes.racket_view import RACKET_COLUMNS, RacketPath, racket_shading_rows
from core.simulation.scenes.scene import SceneConfig
from core.simulation.sensor.sensor import OFF_THRESHOLD, ON_THRESHOLD, SensorConfig, make_pixels
from tests.core.simulation.body_picture import BodyPicture

DENSE_STEP_US: Final = 20
NO_RACKET: Final = (0.0,) * RACKET_COLUMNS


@dataclass(frozen=True, slots=True, eq=False)
class DenseEvents:
    """Events in order of time."""

    t_us: NDArray[np.float64]
    pixel: NDArray[np.int64]
    on: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class SensorAgreement:
    """Of one polarity: how many events the camera has per event of the dense simulation, and the Kolmogorov-Smirnov
    distance of their time stamps.
    """

    events: int
    dense: int
    ks: float

    @property
    def ratio(self) -> float:
        """Events over those of the dense simulation; 1 is perfect."""
        return self.events / self.dense if self.dense else float("nan")


def dense_events(
    camera: Camera,
    scene: SceneConfig,
    config: SensorConfig,
    path: BallPath,
    end_us: int,
    *,
    start_us: int = 0,
    seed: int = 0,
    bodies: MovingBodies | None = None,
    racket: RacketPath | None = None,
) -> DenseEvents:
    """The same sensor model without noise, from `start_us` to `end_us`.

    The thresholds of the pixels are those of an event camera that was made with `np.random.default_rng(seed)`.
    """
    times_us = np.arange(start_us, end_us + 1, DENSE_STEP_US, dtype=np.float64)
    rows = ball_shading_rows(camera, scene, path.at(times_us * 1e-6), path.visible_range(times_us * 1e-6))
    rackets = None
    if racket is not None:
        rackets = racket_shading_rows(camera, scene.racket, scene.edge_px, racket, racket.at(times_us * 1e-6))
    picture = BodyPicture(camera, scene, bodies, make_background(camera, scene))
    pixels = camera.sensor.width_px * camera.sensor.height_px

    def light_at(index: int, out: NDArray[np.float64]) -> None:
        ball = tuple(rows[index].tolist())
        picture.draw(times_us[index] * 1e-6, ball[2] if ball[2] > 0 else np.inf)
        row = NO_RACKET if rackets is None else tuple(rackets[index].tolist())
        picture.render(ball, row, rackets is not None, out)
        out += flicker_log_light(scene, times_us[index])

    light = np.empty(pixels)
    light_at(0, light)
    drawn = make_pixels(light, config, np.random.default_rng(seed)).rows
    receptor, reference, previous = light.copy(), light.copy(), light.copy()
    release_us = np.full(pixels, -1.0)
    keep = np.exp(-DENSE_STEP_US / config.photoreceptor_us) if config.photoreceptor_us > 0 else 0.0
    found: list[tuple[float, int, bool]] = []
    for index in range(1, len(times_us)):
        now_us = times_us[index]
        before_us = now_us - DENSE_STEP_US
        light_at(index, light)
        lag = (light - previous) / DENSE_STEP_US * config.photoreceptor_us
        before, receptor = receptor, light - lag + (receptor - previous + lag) * keep
        released = (release_us > before_us) & (release_us <= now_us)
        share = (release_us[released] - before_us) / DENSE_STEP_US
        reference[released] = before[released] + share * (receptor[released] - before[released])
        free = release_us <= now_us
        for sign, thresholds in ((1.0, drawn[:, ON_THRESHOLD]), (-1.0, drawn[:, OFF_THRESHOLD])):
            for pixel in np.flatnonzero(free & (sign * (receptor - reference) >= thresholds)):
                level = reference[pixel] + sign * thresholds[pixel]
                moved = receptor[pixel] - before[pixel]
                part = np.clip((level - before[pixel]) / moved, 0, 1) if moved else 1.0
                crossing = max(before_us + part * DENSE_STEP_US, release_us[pixel])
                found.append((float(crossing), int(pixel), sign > 0))
                reference[pixel], release_us[pixel] = level, crossing + config.refractory_us
        previous[:] = light
    t, pixel, on = zip(*sorted(found), strict=True) if found else ((), (), ())
    return DenseEvents(np.array(t, np.float64), np.array(pixel, np.int64), np.array(on, np.bool_))


def compare_events(events: Events, dense: DenseEvents) -> dict[str, SensorAgreement]:
    """Compare ON and OFF events apart."""
    found = {}
    for name, polarity in (("on", True), ("off", False)):
        mine, theirs = events.t_us[events.on == polarity], dense.t_us[dense.on == polarity]
        ks = float(ks_2samp(mine, theirs).statistic) if len(mine) and len(theirs) else float("nan")  # type: ignore[union-attr]
        found[name] = SensorAgreement(len(mine), len(theirs), ks)
    return found
