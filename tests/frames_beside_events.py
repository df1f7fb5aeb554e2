"""A small recording of two event cameras and a frame camera, all calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from core.cameras.presets import camera_preset
from core.events import Events
from core.recordings import RecordingWriter

EVENT_CAMERAS: Final = ("near_left", "near_right")
FRAMES: Final = "far_left"
GREY: Final = 120
"""Every pixel of its pictures."""


def write_frames_beside_events(path: Path) -> None:
    """One event in each event camera, and three grey pictures of 1280x720, whose exposures end at 7, 27 and 47 ms."""
    preset = camera_preset("corners")
    calibration = {name: preset[name] for name in (*EVENT_CAMERAS, FRAMES)}
    sizes = {name: camera.sensor for name, camera in calibration.items()}
    with RecordingWriter(path, sizes, calibration=calibration) as writer:
        for name in EVENT_CAMERAS:
            writer.append(name, Events.from_columns([1000], [3], [2], [True], sizes[name]))
        images = np.full((3, 720, 1280), GREY, np.uint8)
        writer.write_frames(FRAMES, np.array([5_000, 25_000, 45_000]), np.full(3, 4_000), images)
        writer.extend_duration(60_000)
