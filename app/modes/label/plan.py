"""Which pictures are to be seen at a time: worked out from what is known, so that neighbours can be made ready."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from app.modes.label.label_changes import ProposedLabel, proposed_at
from app.modes.label.label_picture import BoxMark, CircleMark, LineMark, Mark, PictureKey
from app.modes.label.label_strip import STATE_INKS
from app.modes.label.merge.comparison import LabelComparison
from app.modes.label.merge.pair_picture import pair_legend, pair_marks
from app.modes.label.sources import LabelSource
from app.modes.label.view import LabelView, window_around
from app.pictures.canvas import Region
from app.pictures.event_picture import Rendering
from app.pictures.palette import PaletteIndex, PolarityColours
from core.events import Events
from labels.arrays import LabelArrays, label_arrays
from labels.assist import Proposals, check_stereo, epipolar_curve
from labels.assist.both_views import labelled_positions_at
from labels.model import Label

Point = tuple[float, float]
MAIN_WIDTH_PX = 1280
SIDE_WIDTH_PX = 634
NEAR_US = 60_000
"""Labels farther away say nothing about where the ball is now."""
EPIPOLAR_POINTS = 48
CELL_PX = 16
"""About a ball's radius: side of the squares in which events are counted."""


@dataclass(frozen=True, slots=True, eq=False)
class CameraWork:
    """What is known of the ball in one camera. Replaced, never changed."""

    labels: Mapping[int, Label] = field(default_factory=dict)
    arrays: LabelArrays = field(default_factory=lambda: label_arrays(()))
    proposals: Proposals | None = None
    rejected: frozenset[tuple[int, str]] = frozenset()
    """(time, detector) of proposals that were found wrong."""

    def draft(self, t_us: int) -> ProposedLabel | None:
        """What is proposed where nothing is labelled or rejected."""
        if self.proposals is None or t_us in self.labels or (t_us, self.proposals.detector) in self.rejected:
            return None
        return proposed_at(self.proposals, t_us)

    def known(self, t_us: int) -> Point | None:
        """Where the ball is, if a label or a draft says so."""
        label = self.labels.get(t_us)
        if label is not None:
            return None if label.x_px is None or label.y_px is None else (label.x_px, label.y_px)
        draft = self.draft(t_us)
        return None if draft is None else (draft.x_px, draft.y_px)

    def expected(self, t_us: int) -> Point | None:
        """Where the ball is or, from the labels around, may be."""
        known = self.known(t_us)
        if known is not None:
            return known
        near = self.arrays.between(t_us - NEAR_US, t_us + NEAR_US)
        near = near.rows(near.seen)
        if not len(near):
            return None
        order = np.argsort(np.abs(near.t_us - t_us), kind="stable")[:2]
        x, y, t = near.x_px[order], near.y_px[order], near.t_us[order]
        if len(order) == 1:
            return float(x[0]), float(y[0])
        share = (t_us - t[0]) / (t[1] - t[0])
        return float(x[0] + share * (x[1] - x[0])), float(y[0] + share * (y[1] - y[0]))


@dataclass(frozen=True, slots=True, eq=False)
class LabelScene:
    """Everything that pictures depend on, but for the time and the centre of the zoom."""

    source: LabelSource
    partner: LabelSource | None
    view: LabelView
    rendering: Rendering
    colours: PolarityColours
    here: CameraWork
    there: CameraWork
    """Of the partner."""
    ring: tuple[float, float, float] | None = None
    """A circle that is being drawn."""
    asking: Point | None = None
    """A click that waits for its radius."""
    compared: LabelComparison | None = None
    """Somebody else's labels of the camera that is labelled."""


@dataclass(frozen=True, slots=True)
class PicturePlan:
    """The pictures at one time."""

    t_us: int
    main: PictureKey
    overview: PictureKey
    partner: PictureKey | None
    legend: tuple[tuple[str, PaletteIndex], ...] = ()
    """Whose label is which, where two are drawn in the large picture."""


@dataclass(frozen=True, slots=True)
class CameraAgreement:
    """How well both cameras agree at a time."""

    residual_px: float
    expected_r_px: float
    distance_m: float


def centre_at(scene: LabelScene, t_us: int, before: Point | None) -> Point:
    """The middle of the zoomed picture at a time, coming from another one."""
    view, size = scene.view, scene.source.size
    if view.follow and not view.blind:
        expected = scene.here.expected(t_us)
        if expected is not None:
            return expected
        if view.centre_px is None and view.zoom > 1.0:
            before = busiest_place(scene.source.events(*window_around(t_us, view.window_us))) or before
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
    source, view = scene.source, scene.view
    whole = Region.of_sensor(source.size)
    region = whole if view.zoom <= 1.0 else Region.around(*centre, source.size, view.zoom)
    line = _epipolar(scene, t_us)
    theirs = None if scene.compared is None else scene.compared.theirs_beside(t_us, scene.here.labels.get(t_us))
    own = _work_marks(scene.here, t_us, view.blind)
    legend: tuple[tuple[str, PaletteIndex], ...] = ()
    if scene.compared is not None and theirs is not None:
        pair = (scene.compared.mine.annotator, scene.here.labels.get(t_us)), (scene.compared.theirs.annotator, theirs)
        own, legend = pair_marks(*(label for _, label in pair)), pair_legend(*pair)
    marks = (*own, *line)
    if scene.ring is not None:
        marks = (*marks, CircleMark(*scene.ring, PaletteIndex.TEXT))
    elif scene.asking is not None:
        marks = (*marks, CircleMark(*scene.asking, None, PaletteIndex.ASKS))
    blind = "   second look" if view.blind else ""
    name = f"{source.name}   {t_us / 1e6:.6f} s{blind}"
    main = _key(scene, source, t_us, region, MAIN_WIDTH_PX, marks, name)
    box: tuple[Mark, ...] = (BoxMark(region, PaletteIndex.TEXT),) if view.zoom > 1.0 else ()
    overview = _key(scene, source, t_us, whole, SIDE_WIDTH_PX, (*_bare(marks), *box), "whole picture")
    return PicturePlan(t_us, main, overview, _partner_key(scene, t_us), legend)


def agreement_at(scene: LabelScene, t_us: int) -> CameraAgreement | None:
    """How well this camera's ball agrees with the partner's at the same time."""
    if scene.partner is None or scene.view.blind:
        return None
    here, there = scene.here.known(t_us), other_position(scene, t_us)
    cameras = scene.source.calibration, scene.partner.calibration
    if here is None or there is None or cameras[0] is None or cameras[1] is None:
        return None
    check = check_stereo(cameras[0], here, cameras[1], there)
    residual = float(check.residual_px[0])
    if not np.isfinite(residual):
        return None
    distance = float(np.linalg.norm(check.p_world_m[0] - cameras[0].position_world_m))
    return CameraAgreement(residual, float(check.expected_r_px[0, 0]), distance)


def other_position(scene: LabelScene, t_us: int) -> Point | None:
    """Where the partner sees the ball: its label, its draft, or the curve through its labels."""
    known = scene.there.known(t_us)
    if known is not None or t_us in scene.there.labels:
        return known
    near = scene.there.arrays.between(t_us - 4 * NEAR_US, t_us + 4 * NEAR_US)
    x, y = labelled_positions_at(near, np.array([t_us]))[0].tolist() if len(near) else (np.nan, np.nan)
    return (x, y) if np.isfinite(x) else None


def _epipolar(scene: LabelScene, t_us: int) -> tuple[LineMark, ...]:
    """The partner's ball as a ray in this camera."""
    if scene.partner is None or not scene.view.epipolar or scene.view.blind:
        return ()
    there = other_position(scene, t_us)
    cameras = scene.partner.calibration, scene.source.calibration
    if there is None or cameras[0] is None or cameras[1] is None:
        return ()
    return _line(epipolar_curve(cameras[0], there, cameras[1], points=EPIPOLAR_POINTS))


def _partner_key(scene: LabelScene, t_us: int) -> PictureKey | None:
    partner, view = scene.partner, scene.view
    if partner is None:
        return None
    marks: tuple[Mark, ...] = _work_marks(scene.there, t_us, view.blind)
    here, cameras = scene.here.known(t_us), (scene.source.calibration, partner.calibration)
    if view.epipolar and not view.blind and here is not None and cameras[0] is not None and cameras[1] is not None:
        marks = (*marks, *_line(epipolar_curve(cameras[0], here, cameras[1], points=EPIPOLAR_POINTS)))
    region = Region.of_sensor(partner.size)
    place = scene.there.expected(t_us)
    if view.zoom > 1.0 and view.follow and place is not None:
        region = Region.around(*place, partner.size, view.zoom)
    return _key(scene, partner, t_us, region, SIDE_WIDTH_PX, marks, partner.name)


def _line(points: np.ndarray) -> tuple[LineMark, ...]:
    if len(points) < 2:
        return ()
    return (LineMark(tuple((round(x, 2), round(y, 2)) for x, y in points.tolist()), PaletteIndex.EPIPOLAR),)


def _work_marks(work: CameraWork, t_us: int, blind: bool) -> tuple[Mark, ...]:
    if blind:
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
    window = window_around(t_us, scene.view.window_us) if frame is None else source.exposure(frame)
    return PictureKey(source.name, window, frame, scene.rendering, scene.colours, region, width_px, marks, caption)
