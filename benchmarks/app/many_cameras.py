"""How often the app updates a client that shows several cameras: the scene, their pictures, those of Label."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.app.bare_browser import Visitor
from benchmarks.app.served_app import served
from benchmarks.machine import Row, goal_row
from core.cameras import Camera, stereo_preset
from core.errors import CommandError
from core.geometry import look_at
from core.simulation import LaunchConfig, SensorConfig, StereoConfig, simulate_recording

CAMERAS: Final = 4
MOST_CAMERAS: Final = 9
AWAY_M: Final = 2.3
HIGH_M: Final = 1.4
LOOK_AT_M: Final = (-0.3, 0.0, 0.1)
NOISE_HZ: Final = 1.0
"""Noise events of a pixel in a second."""
SEED: Final = 4
GOAL_HZ: Final = 20.0
PANEL_GOAL_HZ: Final = 10.0
"""Pictures beside the scene are meant to come 15 times a second."""
SECONDS: Final = 3.0
"""Two serves at a quarter of their speed take longer."""
BACK: Final = 100
"""Keys from where a run ends to where it began, or to the start."""
RUNS: Final = 3
KEYS_HZ: Final = 30.0
"""Repetitions of a key that is held."""
PATIENCE_S: Final = 300.0


class PictureVisitor(Visitor):
    """Counts the pictures beside the scene, too."""

    def __init__(self, port: int) -> None:
        self.panel_pictures = 0
        self._flat = ""
        super().__init__(port)

    def _take(self, message: Mapping[str, Any]) -> None:
        super()._take(message)
        if message["type"] == "GuiUpdateMessage" and "_data" in message.get("updates", {}):
            self.panel_pictures += 1
        options = (message.get("props") or {}).get("options") or ()
        # Other modes have a control "Show" too; that of Watch alone offers this.
        if any(str(one).endswith("Pictures") for one in options):
            self._flat = message["uuid"]

    def show_pictures(self) -> None:
        """Show the cameras' pictures in the middle instead of the scene."""
        self.wait_until(lambda: self._flat, "the choice between scene and pictures", PATIENCE_S)
        self.set_value(self._flat, "Pictures")

    @property
    def texts(self) -> tuple[str, ...]:
        """HTML of the panels."""
        return tuple(self._contents.copy().values())


def rig_around(count: int) -> dict[str, Camera]:
    """So many cameras of 1280x720 pixels around the table, all looking at the robot's half.

    Raises:
        CommandError: if it is not 2 to `MOST_CAMERAS`.
    """
    if not 2 <= count <= MOST_CAMERAS:
        raise CommandError("no such number of cameras", expected=f"2 to {MOST_CAMERAS}", got=count, where="--cameras")
    like = next(iter(stereo_preset().values()))
    rig = {}
    for number in range(count):
        turn = 2 * math.pi * (number + 0.5) / count
        position = (AWAY_M * math.cos(turn), AWAY_M * math.sin(turn), HIGH_M)
        rig[f"camera_{number}"] = Camera(like.sensor, like.K, like.distortion, look_at(position, LOOK_AT_M))
    return rig


def measure_cameras(
    folder: Path,
    progress: Callable[[float], None],
    cameras: int = CAMERAS,
    *,
    noise_hz: float = NOISE_HZ,
    seconds: float = SECONDS,
    runs: int = RUNS,
) -> list[Row]:
    """Updates a second while a recording of so many cameras plays in Watch, and while a key is held in Label.

    The median of the runs; the client draws nothing, and is another process than the app.
    """
    file = folder / "cameras.h5"
    config = StereoConfig(sensor=SensorConfig(noise_hz=noise_hz))
    simulate_recording(file, config, rig_around(cameras), [LaunchConfig()] * 2, seed=SEED)
    progress(0.4)
    with served(folder, str(file)) as app:
        visitor = PictureVisitor(app.port)
        try:
            visitor.wait_text("Stereo mismatch", PATIENCE_S)
            visitor.wait_until(
                lambda: not any("has processed" in text for text in visitor.texts), "the chain", PATIENCE_S
            )
            visitor.wait_quiet()
            found = [_watch(visitor, cameras, seconds) for _ in range(runs)]
            progress(0.6)
            visitor.show_pictures()
            visitor.wait_quiet()
            flat = [_play(visitor, lambda: visitor.pictures, seconds) for _ in range(runs)]
            progress(0.8)
            visitor.trigger("Mode: Label")
            visitor.wait_quiet()
            label = [_hold(visitor, seconds) for _ in range(runs)]
        finally:
            visitor.close()
    progress(1.0)
    return _rows(cameras, np.array(found), flat, label)


def _rows(cameras: int, found: np.ndarray, flat: list[float], label: list[float]) -> list[Row]:
    load = f"load {os.getloadavg()[0]:.1f}"
    kinds = (
        ("scene in Watch, updates", found[:, 0], GOAL_HZ),
        ("pictures beside it, of each camera", found[:, 1], PANEL_GOAL_HZ),
        ("all pictures in the middle", np.array(flat), GOAL_HZ),
        ("Label, key held 30 times a second, pictures", np.array(label), GOAL_HZ),
    )
    return [
        goal_row(
            f"{cameras} cameras: {what}",
            float(np.median(rates)),
            goal,
            "1/s",
            least=True,
            note=f"least {rates.min():.1f} of {len(rates)} runs; {load}",
        )
        for what, rates, goal in kinds
    ]


def _watch(visitor: PictureVisitor, cameras: int, seconds: float) -> tuple[float, float]:
    """Scene updates, and pictures of each camera, a second."""
    before = visitor.panel_pictures
    rate = _play(visitor, lambda: len(visitor.updates), seconds)
    return rate, (visitor.panel_pictures - before) / cameras / seconds


def _play(visitor: Visitor, count: Callable[[], int], seconds: float) -> float:
    """How often a second the count grows while the recording plays; it stands again afterwards."""
    visitor.trigger("Play or pause")
    before = count()
    time.sleep(seconds)
    rate = (count() - before) / seconds
    visitor.trigger("Play or pause")
    for _ in range(BACK):
        visitor.trigger("Ten steps back")
    visitor.wait_quiet()
    return rate


def _hold(visitor: Visitor, seconds: float) -> float:
    """Pictures a second while the key of the next time is held."""
    before, began_s = visitor.pictures, time.monotonic()
    while time.monotonic() - began_s < seconds:
        visitor.trigger("Label: Next time")
        time.sleep(1 / KEYS_HZ)
    return (visitor.pictures - before) / seconds
