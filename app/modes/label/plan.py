"""Which pictures are to be seen at a time: worked out from what is known, so that neighbours can be made ready."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from app.modes.label.comparison import pair_legend, pair_marks
from app.modes.label.label_picture import (
    GAP_PX,
    HEIGHT_PX,
    MAIN_WIDTH_PX,
    STATE_INKS,
    USUAL_ASPECT,
    BoxMark,
    CircleMark,
    LineMark,
    Mark,
    PictureKey,
    PicturePlan,
    PointMark,
    SideLayout,
    choose_side_layout,
)
from app.modes.label.labelling import Labelling, Point, window_around
from app.modes.label.sightings import FROM_OTHERS, agreement_at, draft_at, expected_at, positions_at, reprojected_at
from app.modes.label.sources import LabelSource
from app.pictures.canvas import Region, Rendering
from app.pictures.palette import PaletteIndex, PolarityColours
from core.cameras import Camera
from core.events import Events
from labels.assist import epipolar_curve

EPIPOLAR_POINTS = 48
KEPT_RAYS = 256
"""Rays that are kept: of four cameras, six at the cursor and at each of its neighbours."""
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
    aspect: float = USUAL_ASPECT
    """Width over height of what the window leaves to the pictures."""


def centre_at(scene: LabelScene, t_us: int, before: Point | None) -> Point:
    """The middle of the zoomed picture at a time, coming from another one."""
    now, view, size = scene.now, scene.now.view, scene.now.source.size
    if view.follow and not view.repeat:
        expected = expected_at(now, t_us, view.camera)
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
    own, lines = _work_marks(now, t_us, view.camera), _lines(now, t_us)
    # Where two annotators are compared, theirs replaces what is worked on: both at once hide the ball.
    legend: tuple[tuple[str, PaletteIndex], ...] = ()
    if compared is not None and theirs is not None:
        own = pair_marks(mine, theirs)
        legend = pair_legend((compared.mine.annotator, mine), (compared.theirs.annotator, theirs))
    marks = (*own, *lines.get(view.camera, ()))
    if scene.ring is not None:
        marks = (*marks, CircleMark(*scene.ring, PaletteIndex.TEXT))
    elif now.asking is not None:
        marks = (*marks, CircleMark(now.asking.x_px, now.asking.y_px, None, PaletteIndex.ASKS))
    repeat = "   second look" if view.repeat else ""
    name = f"{source.name}   {t_us / 1e6:.6f} s{repeat}"
    main = _key(scene, source, t_us, region, MAIN_WIDTH_PX, marks, name)
    box: tuple[Mark, ...] = (BoxMark(region, PaletteIndex.TEXT),) if view.zoom > 1.0 else ()
    sides = _sides(scene)
    overview = _key(scene, source, t_us, whole, sides.width_px, (*_bare(marks), *box), "whole picture")
    agreement = agreement_at(now, t_us) if len(now.rig) > 2 else None
    off_px = {} if agreement is None else agreement.off_px
    others = tuple(_other_key(scene, other, t_us, lines.get(other.name, ()), off_px) for other in now.others)
    return PicturePlan(t_us, main, overview, others, sides, legend)


def _other_key(
    scene: LabelScene, source: LabelSource, t_us: int, lines: tuple[Mark, ...], off_px: Mapping[str, float]
) -> PictureKey:
    """The picture of a camera beside the labelled one, with its distance from the ball of all where that is known."""
    view, size = scene.now.view, source.size
    marks = (*_work_marks(scene.now, t_us, source.name), *lines)
    region = Region.of_sensor(size)
    place = expected_at(scene.now, t_us, source.name) if view.zoom > 1.0 and view.follow else None
    if place is not None:
        region = Region.around(*place, size, view.zoom)
    caption = f"{source.name}   {off_px[source.name]:.2f} px" if source.name in off_px else source.name
    return _key(scene, source, t_us, region, _sides(scene).width_px, marks, caption)


def _sides(scene: LabelScene) -> SideLayout:
    """Places of the small pictures: the whole picture and the other cameras."""
    size = scene.now.source.size
    ratio = size.height_px / size.width_px
    base_px = MAIN_WIDTH_PX * ratio + HEIGHT_PX + 2 * GAP_PX
    return choose_side_layout(len(scene.now.others) + 1, ratio, base_px, scene.aspect)


def _lines(now: Labelling, t_us: int) -> dict[str, tuple[Mark, ...]]:
    """What the cameras' balls are in each other's pictures, by camera; nothing where one is not calibrated.

    In the labelled one the balls of all others are rays, and a point where two or more have it together; in the others
    its ball is a ray.
    """
    own, rig = now.view.camera, now.rig
    if not now.view.epipolar or now.view.repeat or not rig:
        return {}
    positions = positions_at(now, t_us)
    here = positions.get(own)
    lines: dict[str, tuple[Mark, ...]] = {
        name: () if here is None else _ray(rig[own], (here.x_px, here.y_px), camera)
        for name, camera in rig.items()
        if name != own
    }
    marks: list[Mark] = []
    for name, there in positions.items():
        if name != own:
            marks += _ray(rig[name], (there.x_px, there.y_px), rig[own])
    ball, draft = reprojected_at(now, t_us, own, positions), draft_at(now, t_us)
    if ball is not None and (draft is None or draft.detector != FROM_OTHERS):
        marks.append(PointMark(ball.x_px, ball.y_px, ball.covariance_px2, PaletteIndex.EPIPOLAR))
    return {own: tuple(marks), **lines}


@lru_cache(maxsize=KEPT_RAYS)
def _ray(camera: Camera, point: Point, other: Camera) -> tuple[LineMark, ...]:
    """The ray through a point of `camera` in the picture of `other`; none if it cannot be seen."""
    points = epipolar_curve(camera, point, other, points=EPIPOLAR_POINTS).round(2).tolist()
    return (LineMark(tuple((x, y) for x, y in points), PaletteIndex.EPIPOLAR),) if len(points) > 1 else ()


def _work_marks(now: Labelling, t_us: int, camera: str) -> tuple[Mark, ...]:
    if now.view.repeat:
        return ()
    label, draft = now.works[camera].labels.get(t_us), draft_at(now, t_us, camera)
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
