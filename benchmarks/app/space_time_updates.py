"""What the events in space and time cost: bytes and redraws for each window, and windows a second, without a browser.

Server and client are in this process. The client reads and unpacks what it is sent, and draws nothing: how fast a page
draws is not measured.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import viser

from app.pictures.canvas import Region
from app.pictures.palette import POLARITY_COLOURS
from app.scene.space_time import ROOT, SpaceTimeScene
from app.views.space_time import MOST_POINTS, NEIGHBOURS, SpaceTime, events_in_space, polarity_inks, span_of
from benchmarks.app.bare_browser import CAMERA, connect_to, encoded, messages_in
from benchmarks.machine import Row, goal_row
from core.events import Events, SensorSize
from core.recordings import PixelTruth
from core.recordings.recording import FrozenCamera, Triggers

SENSOR: Final = SensorSize(1280, 720)
WINDOW_US: Final = 2_000
WINDOWS: Final = 100
NOT_COUNTED: Final = 5
"""The first ones load code."""
GOAL_HZ, GOAL_KB = 20.0, 300.0
"""Together 48 Mbit/s: a wireless network."""
PATIENCE_S: Final = 120.0


class SpaceClient:
    """A connection that reads what it is sent."""

    def __init__(self, port: int) -> None:
        self.clouds: queue.Queue[int] = queue.Queue()
        """Bytes of each frame that has events."""
        self.frames = 0
        """Frames that change something of the view: a page redraws after each."""
        self.socket = connect_to(port)
        self.socket.send(encoded(CAMERA))
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for frame in self.socket:
            ours = [message for message in messages_in(frame) if str(message.get("name", "")).startswith(ROOT)]
            self.frames += bool(ours)
            if any("points" in message.get("updates", {}) for message in ours if message["name"] == f"{ROOT}/events"):
                self.clouds.put(len(frame))


def _noise(rng: np.random.Generator, windows: int) -> FrozenCamera:
    """Events anywhere, which compress worst, a tenth more than are drawn."""
    end_us = (windows + 2 * NEIGHBOURS) * WINDOW_US
    t_us = np.sort(rng.integers(0, end_us, int(1.1 * MOST_POINTS * end_us / ((2 * NEIGHBOURS + 1) * WINDOW_US))))
    x, y = (rng.integers(0, size, len(t_us)).astype(np.uint16) for size in (SENSOR.width_px, SENSOR.height_px))
    none = Triggers(np.empty(0, np.int64), np.empty(0, np.bool_), np.empty(0, np.int16))
    events = Events(t_us, x, y, rng.random(len(t_us)) < 0.5, SENSOR)
    return FrozenCamera("noise", SENSOR, None, None, none, events, np.bincount(t_us // 1000))


def _in_space(camera: FrozenCamera, number: int) -> SpaceTime:
    """A window as Label shows it, with a tube of circles."""
    window = (NEIGHBOURS + number) * WINDOW_US, (NEIGHBOURS + number + 1) * WINDOW_US
    t_us = np.arange(*span_of(window), WINDOW_US)
    place = np.linspace(300.0, 316.0, len(t_us))
    ball = PixelTruth(t_us, place, place, np.full(len(t_us), 8.0), np.ones(len(t_us), np.bool_))
    region = Region(0, 0, SENSOR.width_px, SENSOR.height_px)
    colours, joined_us = POLARITY_COLOURS[0], WINDOW_US
    return events_in_space(
        camera,
        window,
        region,
        lambda events: polarity_inks(events, *window),
        colours,
        ball,
        joined_us=joined_us,
        ink=1,
        zero_us=window[1],
    )


def measure_space(
    folder: Path, progress: Callable[[float], None] = lambda share: None, windows: int = WINDOWS
) -> list[Row]:
    """Rows of bytes and redraws for each of so many windows, and of windows a second.

    `folder` is not written to.
    """
    camera = _noise(np.random.default_rng(1), NOT_COUNTED + windows)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    joined: queue.Queue[viser.ClientHandle] = queue.Queue()
    server.on_client_connect(joined.put)
    client = SpaceClient(server.get_port())
    try:
        scene = SpaceTimeScene(joined.get(timeout=PATIENCE_S))
        scene.set_visible(True)
        sizes, points, frames, wall_s, cpu_s = [], 0, 0, 0.0, 0.0
        for number in range(NOT_COUNTED + windows):
            if number == NOT_COUNTED:
                frames, wall_s, cpu_s = client.frames, time.monotonic(), time.process_time()
            shown = _in_space(camera, number)
            scene.show(shown)
            sizes.append(client.clouds.get(timeout=PATIENCE_S))
            points = len(shown.points)
        wall_s, cpu_s = time.monotonic() - wall_s, time.process_time() - cpu_s
        redraws = (client.frames - frames) / windows
    finally:
        client.socket.close()
        server.stop()
    progress(1.0)
    note = f"{points:,} points; {1e3 * cpu_s / windows:.1f} ms of processor time each; load {os.getloadavg()[0]:.0f}"
    return [
        goal_row("events in space and time: sent for a window, p50", float(np.median(sizes)) / 1e3, GOAL_KB, "kB"),
        goal_row("frames for a window, each a redraw", redraws, 1, ""),
        goal_row("windows a second, sent and unpacked", windows / wall_s, GOAL_HZ, "1/s", least=True, note=note),
        goal_row("windows a second that one core keeps up", windows / cpu_s, GOAL_HZ, "1/s", least=True, note=note),
    ]
