"""A part of a recording as moments of the 3D scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from app.export.selection import Span
from app.export.steps import window_length_us
from app.export.unfinished import Cancelled, Progress, check_cancelled
from app.shared.live_rally import positions
from core.chain import ChainConfig, RallyChain
from core.chain.control.controller import BuiltInController
from core.chain.control.player import Player
from core.chain.follow import calibrated_cameras
from core.detection.window import windows_side_by_side
from core.errors import CalibrationError
from core.history.following import is_stereo
from core.history.played_bodies import recorded_bodies
from core.history.rally_history import RallyHistory
from core.history.rally_picture import RallyPicture
from core.history.recorded_history import add_known
from core.recordings import Recording
from core.recordings.layout import Rows

Circles = dict[str, tuple[float, float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class SceneMoment:
    """One instant of a rally, as the 3D scene shows it."""

    t_us: int
    picture: RallyPicture
    circles: Circles
    """u, v, r of the detected ball, px, by camera."""


def scene_moments(
    recording: Recording,
    span: Span,
    chain: ChainConfig,
    stride_us: int,
    groups: Callable[[str], Rows | None],
    progress: Progress,
    cancelled: Cancelled,
) -> Iterator[SceneMoment]:
    """A moment every `stride_us` (rounded to whole windows), from data up to that time only.

    Raises:
        CalibrationError: if the ball cannot be found in space.
    """
    if not is_stereo(recording):
        remedy = "import it with --calibration, or export it to Rerun"
        raise CalibrationError("3D needs two cameras or more, all calibrated", where="the recording", remedy=remedy)
    cameras = calibrated_cameras(recording)
    history, stands = RallyHistory(), positions(cameras)
    add_known(history, recording.ball, _Groups(groups))
    bodies = recorded_bodies(recording)
    player = Player(RallyChain(cameras, chain), BuiltInController())
    window_us = window_length_us(chain)
    every = max(1, round(stride_us / window_us))
    side_by_side = windows_side_by_side(recording.cameras, span.start_us, span.end_us, window_us)
    for number, windows in enumerate(side_by_side, start=1):
        check_cancelled(cancelled)
        state = player.step(windows)
        history.add_step(state)
        if number % every == 0:
            t_us = state.chain.t_us
            moment = history.at(t_us, stands)
            picture = replace(moment.picture, people=bodies.at(t_us))
            yield SceneMoment(t_us, picture, {} if moment.step is None else moment.step.circles)
            progress((t_us - span.start_us) / span.length_us)


class _Groups:
    """Adapter of a function that reads groups."""

    def __init__(self, groups: Callable[[str], Rows | None]) -> None:
        self._groups = groups

    def read_rows(self, group: str) -> Rows | None:
        return self._groups(group)
