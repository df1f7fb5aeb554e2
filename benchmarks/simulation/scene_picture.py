"""What a camera of a scene sees: the light, and the events of a few milliseconds over it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import cv2
import numpy as np

from benchmarks.simulation.dense_sensor import NO_RACKET
from core.cameras import stereo_preset
from core.errors import RallyscopeError
from core.simulation.bodies import make_actors
from core.simulation.bodies.picture import BodyPicture
from core.simulation.bodies.rally_flight import draw_flights
from core.simulation.event_cameras.event_camera import BLOCK_US, EventCamera
from core.simulation.flights.serve import LaunchConfig
from core.simulation.scenes.background import make_background
from core.simulation.scenes.ball_view import ball_shading_rows
from core.simulation.scenes.scene import scene_named
from core.simulation.sensor.sensor import SensorConfig

PLACEMENT: Final = "behind"
AT_US: Final = {"rally": 2_300_000, "head": 280_000}
USUALLY_US: Final = 350_000
SEEN_US: Final = 4_000
ON_BGR, OFF_BGR = (60, 150, 255), (255, 130, 70)
WIDTH_PX: Final = 960


def picture_of_scene(scene: str, path: Path, *, seed: int) -> None:
    """Write the left camera's light, and beside it the events of 4 ms, as a picture 960 pixels wide.

    Raises:
        RallyscopeError: if it cannot be written.
    """
    config, camera = scene_named(scene), stereo_preset(PLACEMENT)["left"]
    flights, strokes = draw_flights(config, [LaunchConfig()] * 2, np.random.default_rng(seed))
    bodies, at_us = make_actors(config.cast, seed, strokes), AT_US.get(scene, USUALLY_US)
    eye = EventCamera(camera, config, SensorConfig(), np.random.default_rng(seed), bodies, at_us - 2 * BLOCK_US)
    events = eye.advance(flights, at_us).between(at_us - SEEN_US, at_us)
    picture, light = BodyPicture(camera, config, bodies, make_background(camera, config)), np.empty(1280 * 720)
    row = ball_shading_rows(camera, config, flights.at([at_us * 1e-6]), flights.portals([at_us * 1e-6]))[0]
    picture.draw(at_us * 1e-6, row[2] if row[2] > 0 else np.inf)
    picture.render(tuple(row.tolist()), NO_RACKET, False, light)
    grey = (255 * np.clip(np.exp(light.reshape(720, 1280)) / 0.9, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    left = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    right = left // 3
    right[events.y_px[events.on], events.x_px[events.on]] = ON_BGR
    right[events.y_px[~events.on], events.x_px[~events.on]] = OFF_BGR
    image = np.hstack([left, right])
    image = cv2.resize(image, (WIDTH_PX, WIDTH_PX * 720 // 2560), interpolation=cv2.INTER_AREA)
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 88]):
        raise RallyscopeError("cannot write the picture", where=path)
