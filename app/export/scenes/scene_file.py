"""The 3D scene with playback, for viser's player, or as a standalone web page.

viser records the messages that a browser would get. So a server is started for a moment, on this machine only, and the
same actors as in the app are moved through the recording.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import viser

from app import theme
from app.export.scenes.moments import scene_moments
from app.export.selection import Span
from app.export.small_png import polarity_png
from app.export.unfinished import Cancelled, Progress, unfinished_file
from app.scene.arena import add_arena
from app.scene.ball import BallActors
from app.scene.landing import LandingActors
from app.scene.people import PeopleActor
from app.scene.prediction import PredictionActors
from app.scene.racket import RacketActor
from app.scene.rig import RigActors
from app.scene.trail import TrailActor
from app.scene.viewpoints import standpoint
from app.web import Admission, Gateway, make_token
from core.cameras import Camera
from core.chain import ChainConfig
from core.chain.follow import calibrated_cameras
from core.events import polarity_image
from core.history.following import is_stereo
from core.history.rally_picture import RallyPicture
from core.recordings import Recording
from core.recordings.layout import Rows

ROOT: Final = "/world"
STRIDE_US: Final = 10_000
EVENTS_US: Final = 5_000
ASPECT: Final = 16 / 9
"""Width over height of the window for which the first view is chosen."""
FRUSTUM_PX: Final = 320
"""Approximate width of the event pictures in the frusta, px."""
SLOWER: Final = 4.0
"""Slow-down of the playback: a serve takes only half a second."""


def export_scene(
    recording: Recording,
    path: Path,
    span: Span,
    chain: ChainConfig,
    *,
    as_html: bool,
    stride_us: int = STRIDE_US,
    groups: Callable[[str], Rows | None] = lambda group: None,
    overwrite: bool = False,
    progress: Progress = lambda share: None,
    cancelled: Cancelled = lambda: False,
) -> Path:
    """Write the scene at every `stride_us`; a slider of the player moves through it.

    Raises:
        CalibrationError: if the ball cannot be found in space.
        CommandError: if the file exists and `overwrite` is not set, or it cannot be written.
        ExportCancelledError: if `cancelled()` is true; there is no file then.
    """
    moments = scene_moments(recording, span, chain, stride_us, groups, progress, cancelled)
    cameras = calibrated_cameras(recording) if is_stereo(recording) else {}
    with unfinished_file(path, overwrite=overwrite) as unfinished, _server_for_a_moment() as server:
        actors = _Actors(server.scene, cameras, chain.predictor.hit_x_m)
        serializer = server.get_scene_serializer()
        for moment in moments:
            actors.show(moment.picture, _event_pictures(recording, moment.t_us))
            server.flush()
            serializer.insert_sleep(SLOWER * stride_us / 1e6)
        if as_html:
            unfinished.write_text(serializer.as_html(dark_mode=True), encoding="utf-8")
        else:
            unfinished.write_bytes(serializer.serialize())
    return path


class _Actors:
    """Moving objects of the scene."""

    def __init__(self, scene: viser.SceneApi, cameras: dict[str, Camera], plane_x_m: float) -> None:
        add_arena(scene, ROOT)
        self._ball = BallActors(scene, ROOT, cameras=len(cameras))
        self._trail = TrailActor(scene, f"{ROOT}/trail")
        self._prediction = PredictionActors(scene, f"{ROOT}/prediction", plane_x_m=plane_x_m)
        self._racket = RacketActor(scene, f"{ROOT}/racket")
        self._racket_target = RacketActor(scene, f"{ROOT}/racket-target", ghost=True)
        self._landing = LandingActors(scene, f"{ROOT}/landing")
        self._people = PeopleActor(scene, f"{ROOT}/people")
        self._rig = RigActors(scene, f"{ROOT}/rig", cameras, pictures=True)

    def show(self, picture: RallyPicture, pngs: dict[str, bytes]) -> None:
        """Show a moment, with the cameras' pictures."""
        self._rig.show(pngs)
        self._ball.show(picture.ball, picture.truth, None)
        self._trail.show(picture.trail, picture.trail_speeds_mps)
        self._ball.show_rays(picture.rays)
        self._prediction.show(picture.before_bounce, picture.after_bounce, picture.bounce, picture.hit, plane=True)
        self._people.show(picture.people)
        self._racket.show(picture.racket)
        self._racket_target.show(picture.racket_target)
        self._landing.show(picture.landing_target, picture.spots)


def _event_pictures(recording: Recording, t_us: int) -> dict[str, bytes]:
    pictures = {}
    for name, stream in recording.cameras.items():
        events = stream.slice(max(0, t_us - EVENTS_US), t_us)
        binning = max(1, round(stream.sensor.width_px / FRUSTUM_PX))
        pictures[name] = polarity_png(polarity_image(events, binning=binning))
    return pictures


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
