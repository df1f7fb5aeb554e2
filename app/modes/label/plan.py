"""Which pictures are to be seen at a time: worked out from what is known, so that neighbours can be made ready."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.modes.label.comparison import pair_legend, pair_marks
from app.modes.label.label_picture import STATE_INKS, BoxMark, CircleMark, LineMark, Mark, PictureKey, PicturePlan
from app.modes.label.labelling import NEAR_US, CameraWork, Labelling, Point, window_around
from app.modes.label.sources import LabelSource
from app.pictures.canvas import Region
from app.pictures.event_picture import Rendering
from app.pictures.palette import PaletteIndex, PolarityColours
from core.events import Events
from labels.assist import check_stereo, epipolar_curve
from labels.assist.both_views import labelled_positions_at

MAIN_WIDTH_PX = 1280
SIDE_WIDTH_PX = 634
EPIPOLAR_POINTS = 48
CELL_PX = 16
"""About a ball's radius: side of the squares in which events are counted."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelScene:
    """Everything that pictures depend on, but for the time and the centre of the zoom."""

    now: Labelling
    rendering: Rendering = "polarity"
    colours: PolarityColours = "orange / blue"
    ring: tuple[float, float, float] | None = None
    """A circle that is being drawn."""


@dataclass(frozen=True, slots=True)
class CameraAgreement:
    """How well both cameras agree at a time."""

    residual_px: float
    expected_r_px: float
    distance_m: float


def centre_at(scene: LabelScene, t_us: int, before: Point | None) -> Point:
    """The middle of the zoomed picture at a time, coming from another one."""
    now, view, size = scene.now, scene.now.view, scene.now.source.size
    if view.follow and not view.repeat:
        expected = now.here.expected(t_us)
        if expected is not None:
            return expected
        if view.centre_px is None and view.zoom > 1.0:
            before = busiest_place(now.source.events(*window_around(t_us, view.window_us))) or before
    return view.centre_px or before or ((size.width_px - 1) / 2, (size.height_px - 1) / 2)


def busiest_place(events: Events) -> Point | None:
    """The mean of the events round where most of them are: a ball is likely there; None without any."""
    if not len(events):
        return None
    columns, rows = events.x_px // CELL_PX, events.y_px // CELL_PX
    width = events.sensor.width_px // CELL_PX + 1
    row, column = divmod(int(np.bincount(rows.astype(np.int64) * width + columns).argmax()), width)
    near = (np.abs(columns.astype(np.int64) - column) <= 1) & (np.abs(rows.astype(np.int64) - row) <= 1)
    return float(events.x_px[near].mean()), float(events.y_px[near].mean())


def plan_at(scene: LabelScene, t_us: int, centre: Point) -> PicturePlan:
    """The pictures at a time."""
    now, source, view, compared = scene.now, scene.now.source, scene.now.view, scene.now.compared_here
    whole = Region.of_sensor(source.size)
    region = whole if view.zoom <= 1.0 else Region.around(*centre, source.size, view.zoom)
    mine = now.here.labels.get(t_us)
    theirs = None if compared is None else compared.theirs_beside(t_us, mine)
    own = _work_marks(now.here, t_us, view.repeat)
    legend: tuple[tuple[str, PaletteIndex], ...] = ()
    if compared is not None and theirs is not None:
        own = pair_marks(mine, theirs)
        legend = pair_legend((compared.mine.annotator, mine), (compared.theirs.annotator, theirs))
    marks = (*own, *_epipolar(now, t_us))
    if scene.ring is not None:
        marks = (*marks, CircleMark(*scene.ring, PaletteIndex.TEXT))
    elif now.asking is not None:
        marks = (*marks, CircleMark(now.asking.x_px, now.asking.y_px, None, PaletteIndex.ASKS))
    repeat = "   second look" if view.repeat else ""
    name = f"{source.name}   {t_us / 1e6:.6f} s{repeat}"
    main = _key(scene, source, t_us, region, MAIN_WIDTH_PX, marks, name)
    box: tuple[Mark, ...] = (BoxMark(region, PaletteIndex.TEXT),) if view.zoom > 1.0 else ()
    overview = _key(scene, source, t_us, whole, SIDE_WIDTH_PX, (*_bare(marks), *box), "whole picture")
    return PicturePlan(t_us, main, overview, _partner_key(scene, t_us), legend)


def agreement_at(now: Labelling, t_us: int) -> CameraAgreement | None:
    """How well this camera's ball agrees with the partner's at the same time."""
    here, there, cameras = now.here.known(t_us), other_position(now, t_us), now.calibrations
    if here is None or there is None or cameras is None or now.view.repeat:
        return None
    check = check_stereo(cameras[0], here, cameras[1], there)
    residual = float(check.residual_px[0])
    if not np.isfinite(residual):
        return None
    distance = float(np.linalg.norm(check.p_world_m[0] - cameras[0].position_world_m))
    return CameraAgreement(residual, float(check.expected_r_px[0, 0]), distance)


def other_position(now: Labelling, t_us: int) -> Point | None:
    """Where the partner sees the ball: its label, its draft, or the curve through its labels."""
    return None if now.there is None else _position(now.there, t_us)


def _position(there: CameraWork, t_us: int) -> Point | None:
    known = there.known(t_us)
    if known is not None or t_us in there.labels:
        return known
    near = there.arrays.between(t_us - 4 * NEAR_US, t_us + 4 * NEAR_US)
    x, y = labelled_positions_at(near, np.array([t_us]))[0].tolist() if len(near) else (np.nan, np.nan)
    return (x, y) if np.isfinite(x) else None


def _epipolar(now: Labelling, t_us: int) -> tuple[LineMark, ...]:
    """The ball of every other camera that knows it as a ray in this camera."""
    here_camera = now.source.calibration
    if not now.view.epipolar or now.view.repeat or here_camera is None:
        return ()
    lines: list[LineMark] = []
    for name, source in now.sources.items():
        if name == now.source.name or source.calibration is None:
            continue
        there = _position(now.works[name], t_us)
        if there is not None:
            lines += _line(epipolar_curve(source.calibration, there, here_camera, points=EPIPOLAR_POINTS))
    return tuple(lines)


def _partner_key(scene: LabelScene, t_us: int) -> PictureKey | None:
    now, partner, there, view = scene.now, scene.now.partner, scene.now.there, scene.now.view
    if partner is None or there is None:
        return None
    marks: tuple[Mark, ...] = _work_marks(there, t_us, view.repeat)
    here, cameras = now.here.known(t_us), now.calibrations
    if view.epipolar and not view.repeat and here is not None and cameras is not None:
        marks = (*marks, *_line(epipolar_curve(cameras[0], here, cameras[1], points=EPIPOLAR_POINTS)))
    region = Region.of_sensor(partner.size)
    place = there.expected(t_us)
    if view.zoom > 1.0 and view.follow and place is not None:
        region = Region.around(*place, partner.size, view.zoom)
    return _key(scene, partner, t_us, region, SIDE_WIDTH_PX, marks, partner.name)


def _line(points: np.ndarray) -> tuple[LineMark, ...]:
    if len(points) < 2:
        return ()
    return (LineMark(tuple((round(x, 2), round(y, 2)) for x, y in points.tolist()), PaletteIndex.EPIPOLAR),)


def _work_marks(work: CameraWork, t_us: int, repeat: bool) -> tuple[Mark, ...]:
    if repeat:
        return ()
    label, draft = work.labels.get(t_us), work.draft(t_us)
    if label is not None and label.x_px is not None and label.y_px is not None:
        return (CircleMark(label.x_px, label.y_px, label.r_px, STATE_INKS[label.state], label.covariance_px2),)
    if draft is not None:
        return (CircleMark(draft.x_px, draft.y_px, draft.r_px, PaletteIndex.DRAFT, draft.covariance_px2),)
    return ()


def _bare(marks: tuple[Mark, ...]) -> tuple[Mark, ...]:
    """Without what is too small to be seen in an overview."""
    return tuple(
        CircleMark(mark.x_px, mark.y_px, mark.r_px, mark.ink) if isinstance(mark, CircleMark) else mark
        for mark in marks
    )


def _key(
    scene: LabelScene,
    source: LabelSource,
    t_us: int,
    region: Region,
    width_px: int,
    marks: tuple[Mark, ...],
    caption: str,
) -> PictureKey:
    frame = source.frame_at(t_us)
    window = window_around(t_us, scene.now.view.window_us) if frame is None else source.exposure(frame)
    return PictureKey(source.name, window, frame, scene.rendering, scene.colours, region, width_px, marks, caption)
