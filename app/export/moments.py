"""A part of a recording as the 3D scene shows it, moment after moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from app.export.selection import Span
from app.export.steps import window_length_us
from app.export.unfinished import Cancelled, Progress, check_cancelled
from app.scene.rally_picture import LandingSpot, RallyPicture
from app.watch.following import is_stereo
from app.watch.history import Outcome, RallyHistory
from app.watch.live import positions
from core.detection.window import windows_between
from core.errors import CalibrationError
from core.rally import ChainConfig, RallyChain
from core.rally.controller import BuiltInController
from core.rally.follow import calibrated_cameras
from core.rally.player import Player
from core.recordings import Recording
from core.recordings.layout import Rows
from core.simulation.physics.episode import Case

Circles = dict[str, tuple[float, float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class SceneMoment:
    """One of them."""

    t_us: int
    picture: RallyPicture
    circles: Circles
    """u, v, r in pixels of the ball that was found, by camera."""


def scene_moments(
    recording: Recording,
    span: Span,
    chain: ChainConfig,
    stride_us: int,
    groups: Callable[[str], Rows | None],
    progress: Progress,
    cancelled: Cancelled,
) -> Iterator[SceneMoment]:
    """What is known every `stride_us` (rounded to whole windows), nothing of it from later.

    Raises:
        CalibrationError: if the ball cannot be found in space.
    """
    if not is_stereo(recording):
        remedy = "import it with --calibration, or export it to Rerun"
        raise CalibrationError("3D needs two cameras or more, all calibrated", where="the recording", remedy=remedy)
    cameras = calibrated_cameras(recording)
    history, stands = _known(recording, groups), positions(cameras)
    player = Player(RallyChain(cameras, chain), BuiltInController())
    window_us = window_length_us(chain)
    every = max(1, round(stride_us / window_us))
    streams = [windows_between(recording.cameras[name], span.start_us, span.end_us, window_us) for name in cameras]
    for number, windows in enumerate(zip(*streams, strict=True), start=1):
        check_cancelled(cancelled)
        history.add_step(player.step(dict(zip(cameras, windows, strict=True))))
        if number % every == 0:
            t_us = windows[0].end_us
            moment = history.at(t_us, stands)
            yield SceneMoment(t_us, moment.picture, {} if moment.step is None else moment.step.circles)
            progress((t_us - span.start_us) / span.length_us)


def _known(recording: Recording, groups: Callable[[str], Rows | None]) -> RallyHistory:
    """What the recording itself says of ball, racket and outcomes."""
    history = RallyHistory()
    if recording.ball is not None:
        history.add_truth(recording.ball)
    racket, episodes = groups("/racket"), groups("/episodes")
    if racket is not None:
        history.add_rackets(*(np.asarray(racket[name]) for name in ("t_us", "p_world_m", "q_world_wxyz")))
    if episodes is not None:
        columns = (episodes[name].tolist() for name in ("serve_us", "speed_mps", "case", "f"))
        for serve_us, speed_mps, case, landing in zip(*columns, strict=True):
            spot = LandingSpot(landing[0], landing[1], Case(case))
            history.add_outcome(Outcome(serve_us, serve_us, speed_mps, spot))
    return history
