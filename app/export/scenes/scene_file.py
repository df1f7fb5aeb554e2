"""The 3D scene with playback, for viser's player, or as a standalone web page.

viser records the messages that a browser would get. So a server is started for a moment, on this machine only, and the
same actors as in the app are moved through the recording.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import viser

from app import theme
from app.export.steps import window_length_us
from app.export.task import ExportTask
from app.export.unfinished import check_cancelled, unfinished_file
from app.formatting import html_text
from app.scene.arena import RacketActor, RigActors, add_arena
from app.scene.ball import BallActors, TrailActor
from app.scene.people import PeopleActor
from app.scene.prediction import LandingActors, PredictionActors
from app.scene.view_camera import standpoint
from app.shared.live_rally import positions
from app.viser_parts import TITLE
from app.web import Admission, Gateway, make_token
from core.cameras import Camera
from core.chain import RallyChain
from core.chain.control.controller import BuiltInController
from core.chain.control.player import Player
from core.chain.follow import calibrated_cameras
from core.detection.window import windows_side_by_side
from core.errors import CalibrationError
from core.history.following import add_known, is_stereo
from core.history.played_bodies import recorded_bodies
from core.history.rally_history import RallyHistory
from core.history.rally_picture import RallyPicture
from core.recordings.layout import Rows

Circles = dict[str, tuple[float, float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class SceneMoment:
    """One instant of a rally, as the 3D scene shows it."""

    t_us: int
    picture: RallyPicture
    circles: Circles
    """u, v, r of the detected ball, px, by camera."""


def scene_moments(task: ExportTask, stride_us: int) -> Iterator[SceneMoment]:
    """A moment every `stride_us` (rounded to whole windows), from data up to that time only.

    Raises:
        CalibrationError: if the ball cannot be found in space.
    """
    recording, span, chain = task.recording, task.span, task.order.chain
    if not is_stereo(recording):
        remedy = "import it with --calibration, or export it to Rerun"
        raise CalibrationError("3D needs two cameras or more, all calibrated", where="the recording", remedy=remedy)
    cameras = calibrated_cameras(recording)
    history, stands = RallyHistory(), positions(cameras)
    add_known(history, recording.ball, _Groups(task.groups))
    bodies = recorded_bodies(recording)
    player = Player(RallyChain(cameras, chain), BuiltInController())
    window_us = window_length_us(chain)
    # The chain takes every window in between: it remembers.
    every = max(1, round(stride_us / window_us))
    side_by_side = windows_side_by_side(recording.cameras, span.start_us, span.end_us, window_us)
    for number, windows in enumerate(side_by_side, start=1):
        check_cancelled(task.cancelled)
        state = player.step(windows)
        history.add_step(state)
        if number % every == 0:
            t_us = state.chain.t_us
            moment = history.at(t_us, stands)
            picture = replace(moment.picture, people=bodies.at(t_us))
            yield SceneMoment(t_us, picture, {} if moment.step is None else moment.step.circles)
            task.progress((t_us - span.start_us) / span.length_us)


class _Groups:
    """Adapter of a function that reads groups."""

    def __init__(self, groups: Callable[[str], Rows | None]) -> None:
        self._groups = groups

    def read_rows(self, group: str) -> Rows | None:
        return self._groups(group)


ROOT: Final = "/world"
STRIDE_US: Final = 10_000
ASPECT: Final = 16 / 9
"""Width over height of the window for which the first view is chosen."""
SLOWER: Final = 4.0
"""Slow-down of the playback: a serve takes only half a second. viser's player cannot begin slowly, so the times of a
file for it are stretched; a web page keeps the recording's times and brings its own player, which begins slowly."""
CLOCK_M: Final = (0.0, -1.1, 0.3)
"""Place of the clock: beside the net, on the viewer's side."""


PLAYER: Final = (
    """<style>
  .mantine-NumberInput-root { display: none }
  .mantine-Select-wrapper { width: 5.2em !important }
</style><script>{
  const append = document.head.appendChild;
  document.head.appendChild = function (node) {
    if (node.type === "module") {
      const none = "{type:'EnvironmentMapMessage',hdri_data:null,background:false,background_blurriness:0," +
        "background_intensity:1,background_wxyz:[1,0,0,0],environment_intensity:1,environment_wxyz:[1,0,0,0]}";
      node.textContent = node.textContent.replace(
        "enableDefaultLights:!0,enableDefaultLightsShadows:!0,environmentMap:null",
        () => "enableDefaultLights:!1,enableDefaultLightsShadows:!1,environmentMap:" + none
      ).replace("useState)(`1x`)", "useState)(`SLOWx`)"
      ).replace("[`0.5x`,`1x`,`2x`,`4x`,`8x`]", "[`0.05x`,`0.1x`,`SLOWx`,`0.5x`,`1x`]");
    }
    return append.call(this, node);
  };
}</script>"""
).replace("SLOW", f"{1 / SLOWER:g}")
"""Changes of the page to viser's player, which unpacks itself: it has no lamps of its own, begins slowly, and shows no
clock of its own.

It would light the scene with its lamps each time it begins again, until the recorded messages switch them off: on a
slow machine for seconds. Its clock counts from the start of the part, in no unit, and would contradict the clock in the
scene. Where a later player calls these otherwise they are as viser makes them: the page then begins at full speed.
"""


def export_scene(task: ExportTask) -> tuple[Path, ...]:
    """Write the scene at every stride, as a web page or for viser's player, whose slider moves through it.

    Raises:
        CalibrationError: if the ball cannot be found in space.
    """
    recording, stride_us = task.recording, task.order.stride_us or STRIDE_US
    moments = scene_moments(task, stride_us)
    cameras = calibrated_cameras(recording) if is_stereo(recording) else {}
    with (
        unfinished_file(task.path, overwrite=task.order.overwrite) as unfinished,
        _server_for_a_moment() as server,
    ):
        slower = 1.0 if task.order.format == "html" else SLOWER
        actors = _Actors(server.scene, cameras, task.order.chain.predictor.hit_x_m, slower)
        serializer = server.get_scene_serializer()
        for moment in moments:
            with server.atomic():  # a moment is shown when all of it is there
                actors.show(moment.picture, moment.t_us)
            server.flush()
            serializer.insert_sleep(slower * stride_us / 1e6)
        if task.order.format == "html":
            page = serializer.as_html(dark_mode=True)
            title = f"<title>{html_text(task.path.stem)}</title>"
            page = page.replace("<head>", f"<head>{PLAYER}", 1).replace(TITLE, title, 1)
            unfinished.write_text(page, encoding="utf-8")
        else:
            unfinished.write_bytes(serializer.serialize())
    return (task.path,)


class _Actors:
    """Moving objects of the scene."""

    def __init__(self, scene: viser.SceneApi, cameras: dict[str, Camera], plane_x_m: float, slower: float) -> None:
        add_arena(scene, ROOT)
        self._ball = BallActors(scene, ROOT)
        self._trail = TrailActor(scene, f"{ROOT}/trail")
        self._prediction = PredictionActors(scene, f"{ROOT}/prediction", plane_x_m=plane_x_m)
        self._racket = RacketActor(scene, f"{ROOT}/racket")
        self._racket_target = RacketActor(scene, f"{ROOT}/racket-target", ghost=True)
        self._landing = LandingActors(scene, f"{ROOT}/landing")
        self._people = PeopleActor(scene, f"{ROOT}/people")
        RigActors(scene, f"{ROOT}/rig", cameras)  # without pictures, which would hide the target
        self._slower = slower
        self._clock = scene.add_label(f"{ROOT}/clock", clock_text(0, slower), position=CLOCK_M)

    def show(self, picture: RallyPicture, t_us: int) -> None:
        """Show the moment of a time."""
        self._clock.text = clock_text(t_us, self._slower)
        self._ball.show(picture.ball, picture.truth, None)
        self._trail.show(picture.trail, picture.trail_speeds_mps)
        self._ball.show_rays(picture.rays)
        self._prediction.show(picture.before_bounce, picture.after_bounce, picture.bounce, picture.hit, plane=True)
        self._prediction.show_places(picture.hit_places, picture.refused_places)
        self._people.show(picture.people)
        self._racket.show(picture.racket)
        self._racket_target.show(picture.racket_target)
        self._landing.show(picture.landing_target, picture.spots)


def clock_text(t_us: int, slower: float) -> str:
    """The recording's time; with the factor where the times of the file are stretched, as its player counts those."""
    stretched = "" if slower == 1.0 else f" (x 1/{slower:g})"
    return f"{t_us / 1e6:.3f} s{stretched}"


@contextlib.contextmanager
def _server_for_a_moment() -> Iterator[viser.ViserServer]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    server = Gateway("127.0.0.1", port, Admission(token=make_token())).server  # nobody comes in
    try:
        theme.apply_theme(server)
        view = standpoint("Broadcast", ASPECT)
        server.initial_camera.position, server.initial_camera.look_at = view.position, view.look_at
        server.initial_camera.fov = view.fov_rad
        yield server
    finally:
        server.stop()
