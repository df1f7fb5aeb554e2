"""The picture one should see at each step of `docs/use/your-lab.md`: the app on replayed simulations.

`docs/make_images.py` calls this. No camera is here: the pictures are of events that were simulated or drawn.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image
from playwright.sync_api import Page

from app.modes.watch.commands import ShowSpace
from app.modes.watch.table import ChooseTableCorner, ClickTableCorner, LetTableBeClicked
from app.session import Session
from app.shared.live_rally import LIVE, LiveRally
from app.shared.workspace import Workspace
from app.state.commands import SetMethod, SetMode, SetOverlay, SetWindow, SetZoom, StopAt
from core.cameras import stereo_preset
from core.cameras.calibration.table_corners import CORNERS
from core.cameras.presets import SENSOR_720
from core.devices.neuromorphic import open_camera
from core.events import Events
from core.live.camera_source import CameraSource
from core.live.replay_source import ReplaySource
from core.recordings import CameraStream, open_recording
from core.robot import RobotClient, RobotWatchConfig
from docs.headless_app import show_app, still_picture, wait_for
from docs.lab_events import write_noise, write_stripes
from tests.core.devices.replayed_hardware import Replayed, ReplayedLibrary

EXAMPLE: Final = Path("docs/examples/example_robot.py")
STILL_WINDOW_US: Final = 20_000
PICTURES: Final = (0, 116, 870, 640)
"""Left, top, right, bottom: what fills the middle."""
SOURCE: Final = (876, 255, 1280, 598)
"""What is said of a live source, among the controls."""
LARGE: Final = (0, 0, 870, 490)
"""One picture, without the tables below it."""
ROBOT: Final = (876, 254, 1280, 548)
"""The robot's folder."""
UPPER: Final = (0, 0, 1280, 416)
MOST: Final = (0, 0, 1280, 478)
SCENE: Final = (0, 0, 876, 720)
"""All but the controls."""
CORNER_CLICKS: Final = ("net-left", "net-right", "robot-centre", "post-left", "post-right")
"""Both cameras see these."""
CLICK_PX: Final = 0.7
"""How well a person clicks."""
BEFORE_HIT_US: Final = 60_000
SLOWLY: Final = 0.25
"""Real time is not kept by a browser that draws without a graphics card."""
PATIENT: Final = RobotWatchConfig(lost_ms=5000.0, slow_ms=1000.0)


@dataclass(frozen=True, slots=True)
class LabRecordings:
    """What the pictures are of; `rally` has a serve that is returned."""

    workspace: Workspace
    rally: Path

    def write(self) -> None:
        """Those that are drawn."""
        write_noise(self.workspace.recording_path("still"))
        write_stripes(self.workspace.recording_path("stripes"), SENSOR_720, {"sharp": 0.7, "blurred": 4.0})


def take_lab_pictures(recordings: LabRecordings, only: str | None) -> Iterator[tuple[str, Image.Image]]:
    """Each step's name with its picture."""
    recordings.write()
    for name, take in STEPS.items():
        if only in (None, name):
            yield name, take(recordings)


def take_still(recordings: LabRecordings) -> Image.Image:
    """Two cameras that see nothing but their own noise."""
    with show_app(recordings.workspace, "still") as (page, session):
        flat(page, session, STILL_WINDOW_US)
        seek(page, session, 200_000)
        return shot(page, PICTURES)


def take_focus(recordings: LabRecordings) -> Image.Image:
    """The same stripes in focus and out of it."""
    with show_app(recordings.workspace, "stripes") as (page, session):
        flat(page, session, 5_000)
        seek(page, session, 40_000)
        return shot(page, PICTURES)


def take_crescent(recordings: LabRecordings) -> Image.Image:
    """A ball, large: one polarity ahead, the other behind."""
    with show_app(recordings.workspace, "rally") as (page, session):
        session.send(SetMode("Tune"))
        session.send(SetMethod("auto"))
        session.send(SetOverlay("raw"))
        session.send(SetZoom(8.0))
        seek(page, session, coming_us(session))
        page.wait_for_timeout(2000)
        return shot(page, LARGE)


def take_clocks(recordings: LabRecordings) -> Image.Image:
    """Two cameras without a cable, and how well their clocks are known."""
    with open_recording(recordings.workspace.recording_path("still")) as recording:
        again = {name: Again(stream, recording.duration_us) for name, stream in recording.cameras.items()}
        cameras = [
            Replayed(stream=one, duration_us=10**10, drift=drift, jitter_s=0.0005, offset_us=offset_us)
            for one, drift, offset_us in zip(again.values(), (1.2e-5, -2.1e-5), (0, 73_000), strict=True)
        ]
        library = ReplayedLibrary({f"0005042{2 * k + 1}": one for k, one in enumerate(cameras)})
        devices = {name: open_camera(f"0005042{2 * k + 1}", driver=library) for k, name in enumerate(again)}
        calibration = {name: stream.calibration for name, stream in recording.cameras.items() if stream.calibration}
        live = LiveRally(CameraSource(devices, calibration=calibration))
        with show_app(recordings.workspace, LIVE, live) as (page, session):
            flat(page, session, STILL_WINDOW_US)
            page.get_by_text("ppm against this machine").nth(1).wait_for()
            page.wait_for_timeout(20_000)  # their drift becomes known
            return shot(page, SOURCE)


def take_sweep(recordings: LabRecordings) -> Image.Image:
    """The guide, after a ball went some ways."""
    with replayed(recordings, SLOWLY) as (page, session, _):
        flat(page, session, 5_000)
        open_folder(page, "Sweep of the ball")
        page.get_by_label("Show what is missing").check()
        page.get_by_text("of 48 parts").nth(1).wait_for()

        def swept() -> bool:
            assert session.state is not None
            return all(len(session.state.watch.swept.missing(name)) <= 40 for name in session.state.cameras)

        wait_for(swept, "the ball to be counted")
        page.mouse.move(440, 560)  # its hint goes
        page.wait_for_timeout(500)
        return shot(page, UPPER)


def take_corners(recordings: LabRecordings) -> Image.Image:
    """Corners clicked in both pictures, and the table drawn over them."""
    rng = np.random.default_rng(1)
    with replayed(recordings, SLOWLY) as (page, session, _):
        flat(page, session, STILL_WINDOW_US)
        open_folder(page, "Table")
        session.send(LetTableBeClicked(True))
        for name, camera in stereo_preset().items():
            for corner in CORNER_CLICKS:
                u_px, v_px = camera.project(np.array([CORNERS[corner]]))[0] + rng.normal(0, CLICK_PX, 2)
                choose(session, corner)
                session.send(ClickTableCorner(name, float(u_px), float(v_px)))
        page.get_by_text("px off, most").nth(1).wait_for()
        return shot(page, MOST)


def take_ball(recordings: LabRecordings) -> Image.Image:
    """The ball in space, and that the cameras fit each other."""
    with replayed(recordings, 0.5) as (page, session, live):
        wait_for(lambda: session.world.visible, "the scene")
        wait_for(lambda: live.drift.drift is not None, "the calibration to be judged")
        page.get_by_text("fits to").wait_for()
        pause_at_hit(page, session, live)
        return shot(page, SCENE)


def take_strokes(recordings: LabRecordings) -> Image.Image:
    """What came of strokes."""
    with replayed(recordings, 0.5) as (page, session, live):
        wait_for(lambda: session.world.visible, "the scene")
        wait_for(lambda: live.history.outcome_count >= 3, "strokes to be judged")
        page.get_by_text("Strokes, as seen").first.wait_for()
        pause(page, session)
        seek(page, session, live.history.outcomes_between(-1, 1 << 62)[-1].t_us)
        page.mouse.move(140, 560)
        page.mouse.wheel(0, 1000)
        page.wait_for_timeout(1000)
        return shot(page, SCENE)


def take_robot(recordings: LabRecordings) -> Image.Image:
    """The example robot before the first ball, after its step test."""
    quiet = recordings.workspace.recording_path("still")
    with example_robot() as robot, replayed(recordings, 1.0, robot, quiet) as (page, session, live):
        flat(page, session, STILL_WINDOW_US)
        wait_for(lambda: robot.status.connection == "ready", "the robot")
        page.get_by_role("button", name="Start the robot", exact=True).click()
        page.get_by_text("yes: it is sent to the balls").wait_for()
        page.wait_for_timeout(1500)
        page.get_by_role("button", name="Step test", exact=True).click()
        wait_for(lambda: live.player.latency is not None, "the step test to end")
        page.get_by_text("steps to another").wait_for()
        page.mouse.move(440, 560)
        page.wait_for_timeout(500)
        return shot(page, ROBOT)


class Again:
    """What a camera of a recording saw, again and again."""

    def __init__(self, stream: CameraStream, round_us: int) -> None:
        self.sensor, self._stream, self._round_us = stream.sensor, stream, round_us

    def slice(self, start_us: int, end_us: int) -> Events:
        """The part that falls on these times; one across the seam ends there."""
        later_us = start_us // self._round_us * self._round_us
        seen = self._stream.slice(start_us - later_us, min(end_us - later_us, self._round_us))
        return Events.from_columns(seen.t_us + later_us, seen.x_px, seen.y_px, seen.on, seen.sensor)


@contextmanager
def replayed(
    recordings: LabRecordings, speed: float, robot: RobotClient | None = None, path: Path | None = None
) -> Iterator[tuple[Page, Session, LiveRally]]:
    """The rally, or another recording, as if cameras saw it now."""
    recording = open_recording(path or recordings.rally)
    live = LiveRally(ReplaySource(recording, "two cameras", speed=speed), robot=robot)
    with show_app(recordings.workspace, LIVE, live) as (page, session):
        yield page, session, live


@contextmanager
def example_robot() -> Iterator[RobotClient]:
    """In another process."""
    process = subprocess.Popen(
        [sys.executable, str(EXAMPLE)], stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": "."}
    )
    try:
        assert process.stdout is not None
        yield RobotClient(process.stdout.readline().strip(), config=PATIENT)
    finally:
        process.kill()
        process.wait()


def flat(page: Page, session: Session, window_us: int) -> None:
    """Show the pictures, large, of so long a window."""
    session.send(ShowSpace(False))
    session.send(SetWindow(window_us))
    wait_for(lambda: session.sheet.pictures, "the pictures")
    page.wait_for_timeout(1000)


def seek(page: Page, session: Session, t_us: int) -> None:
    """Stand still at a time."""
    session.send(StopAt(t_us))
    wait_for(lambda: session.state is not None and session.state.playhead.anchor_us == t_us, f"the cursor at {t_us} us")
    page.wait_for_timeout(1500)


def coming_us(session: Session) -> int:
    """A tenth of a second before the ball is hit."""
    assert session.recording is not None and session.recording.ball is not None
    ball = session.recording.ball
    return int(ball.t_us[ball.visible & (ball.v_world_mps[:, 0] < 0)][-1]) - 100_000


def pause(page: Page, session: Session) -> None:
    """Follow no longer."""
    page.get_by_role("button", name="Pause", exact=True).first.click()
    wait_for(lambda: session.state is not None and not session.state.playhead.playing, "it to stand")


def pause_at_hit(page: Page, session: Session, live: LiveRally) -> None:
    """Stand still shortly before the newest hit that was predicted."""
    pause(page, session)
    followed_us = live.history.followed_us
    hits_us = [1e6 * hit.t_s for _, hit in live.history.predicted_hits() if 1e6 * hit.t_s < followed_us]
    seek(page, session, round(hits_us[-1]) - BEFORE_HIT_US)
    page.wait_for_timeout(2000)


def choose(session: Session, corner: str) -> None:
    """The next click is of this one."""
    session.send(ChooseTableCorner(corner))


def open_folder(page: Page, name: str) -> None:
    """Unfold one of the panel's."""
    page.get_by_text(name, exact=True).first.click()
    page.wait_for_timeout(500)


def shot(page: Page, box: tuple[int, int, int, int]) -> Image.Image:
    """A part of the window."""
    return still_picture(page).crop(box)


STEPS: Final[dict[str, Callable[[LabRecordings], Image.Image]]] = {
    "still": take_still,
    "focus": take_focus,
    "crescent": take_crescent,
    "clocks": take_clocks,
    "sweep": take_sweep,
    "corners": take_corners,
    "ball": take_ball,
    "strokes": take_strokes,
    "robot": take_robot,
}
