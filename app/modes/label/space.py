"""The events round Label's cursor in space and time, and the labels in them, drawn as Tune draws its windows.

They are coloured by polarity, or by what the detector makes of its window round the cursor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.background.jobs import LatestWins
from app.modes.label.labelling import Point, window_around
from app.modes.label.plan import LabelScene
from app.modes.label.sightings import draft_at
from app.modes.mode import ModeHost
from app.pictures.canvas import Region
from app.pictures.palette import PaletteIndex, PolarityColours
from app.state.client_state import ClientState, SpaceColour
from app.views.space_time import SpaceTime, answer_inks, events_in_space, polarity_inks, span_of
from core.detection.methods import method_config
from core.detection.saved import SavedDetector
from core.events import Events
from core.metrics.run import explain_window
from core.recordings import CameraStream

Array = NDArray[np.float64]
NO_RADIUS_PX: Final = 0.0
"""Radius of a label that has none: a point is drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelCircles:
    """N circles of labels, by time."""

    t_us: NDArray[np.int64]
    u_px: Array
    v_px: Array
    r_px: Array


@dataclass(frozen=True, slots=True, eq=False)
class LabelSpaceRequest:
    """Request for the events round a time."""

    stream: CameraStream
    t_us: int
    window: tuple[int, int]
    region: Region
    colours: PolarityColours
    step_us: int
    circles: LabelCircles
    """Labels of the windows shown."""
    here: tuple[float, float, float] | None
    """Circle at the time itself: the label, or else what is proposed."""
    is_draft: bool
    detector: SavedDetector
    stage: str
    """The one that Tune shows of that detector."""
    colour: SpaceColour


def space_request(scene: LabelScene, centre: Point, state: ClientState) -> LabelSpaceRequest | None:
    """What is to be seen at the cursor; None for frames, which have no events.

    A repeat annotation shows no label, and nothing of what the detector says.
    """
    now, view, stream = scene.now, scene.now.view, scene.now.source.stream
    if stream is None:
        return None
    window, size = window_around(now.t_us, view.window_us), now.source.size
    region = Region.of_sensor(size) if view.zoom <= 1.0 else Region.around(*centre, size, view.zoom)
    near = now.here.arrays.between(*span_of(window))
    near = near.rows(near.seen & (not view.repeat))
    circles = LabelCircles(near.t_us, near.x_px, near.y_px, near.r_px)
    label = None if view.repeat else now.here.labels.get(now.t_us)
    draft = None if view.repeat or label is not None else draft_at(now, now.t_us)
    ball, here = label or draft, None
    if ball is not None and ball.x_px is not None and ball.y_px is not None:
        here = (ball.x_px, ball.y_px, ball.r_px or NO_RADIUS_PX)
    step_us = max(now.step_us, view.window_us)
    return LabelSpaceRequest(
        stream,
        now.t_us,
        window,
        region,
        scene.colours,
        step_us,
        circles,
        here,
        draft is not None,
        state.detector,
        state.tune.stage,
        "polarity" if view.repeat else view.space_colour,
    )


def answer_space(request: LabelSpaceRequest) -> SpaceTime:
    """Events in their colours, the labels as a tube, and the circle at the cursor through its window."""
    return events_in_space(
        request.stream,
        request.window,
        request.region,
        _inks_of(request),
        request.colours,
        request.circles,
        joined_us=request.step_us,
        ink=PaletteIndex.LABEL,
        zero_us=request.t_us,
        mark=request.here,
        mark_ink=PaletteIndex.DRAFT if request.is_draft else PaletteIndex.LABEL,
    )


def _inks_of(request: LabelSpaceRequest) -> Callable[[Events], NDArray[np.uint8]]:
    if request.colour == "polarity":
        return lambda events: polarity_inks(events, *request.window)
    method, config = request.detector
    _, end_us = window_around(request.t_us, method_config(method, config).window.window_us)
    answer = explain_window(request.stream, method, config, end_us)
    return lambda events: answer_inks(events, request.window, answer, request.stage, request.colour)


class LabelSpaceView:
    """Draws what the cursor points at, in the background. Methods are called by the loop."""

    def __init__(self, host: ModeHost, shown: Callable[[SpaceTime], None], failed: Callable[[Exception], None]) -> None:
        """`shown` is called by the loop with what was drawn, `failed` by another thread."""
        self._host, self._shown = host, shown
        self._asked: object = None
        self._work = LatestWins(host.pool, answer_space, self._drawn, failed)

    def close(self) -> None:
        """The browser is gone."""
        self._work.close()

    def forget(self) -> None:
        """It is not on the screen: what was asked for is not to be shown any more."""
        self._asked = None

    def ask(self, scene: LabelScene, centre: Point, state: ClientState, wall_s: float) -> None:
        """Draw what is to be seen now, unless that was asked for."""
        now = scene.now
        key = (now.t_us, now.view, now.here, now.step_us, centre, scene.colours, state.detector, state.tune.stage)
        request = None if key == self._asked else space_request(scene, centre, state)
        if request is not None:
            self._asked = key
            self._host.plane.freshness.ask(request, wall_s)
            self._work.submit(request)

    def _drawn(self, request: LabelSpaceRequest, answer: SpaceTime) -> None:
        self._host.later(lambda: self._show(request, answer))

    def _show(self, request: LabelSpaceRequest, answer: SpaceTime) -> None:
        if self._asked is not None:
            self._host.plane.freshness.answered(request)
            self._host.space.show(answer)
            self._shown(answer)
