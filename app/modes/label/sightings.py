"""What the cameras know of the ball at a time together: how well they agree, and where the others place it in each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from app.modes.label.label_changes import ProposedLabel
from app.modes.label.labelling import NEAR_US, CameraWork, Labelling, Point
from core.cameras import Camera, ball_circles
from labels.assist import check_stereo
from labels.assist.stereo import BallInSpace, Position, Reprojection, ball_in_space, labelled_positions_at, reproject

FROM_OTHERS: Final = "other cameras"
"""What a label or a proposal says it was proposed by, if it follows from labels of other cameras."""
ONE_BALL_PX: Final = 3.0
"""Balls of other cameras that agree less are not of one ball, and place it nowhere else."""
KEPT: Final = 128
"""Balls that are kept: those of the cursor and its neighbours."""


@dataclass(frozen=True, slots=True)
class CameraAgreement:
    """How well the cameras agree at a time."""

    residual_px: float
    expected_r_px: float
    """Radius of the ball in the camera that is labelled; nan behind it."""
    distance_m: float
    off_px: Mapping[str, float]
    """Distance of each camera's ball from that of all in its picture, by name; empty for a pair."""
    left_out: frozenset[str] = frozenset()
    """Cameras that have the ball elsewhere than the others."""


def agreement_at(now: Labelling, t_us: int) -> CameraAgreement | None:
    """How well the cameras agree at a time; None for a pair unless the labelled camera has a ball."""
    rig = now.rig
    if now.view.repeat or len(rig) < 2:
        return None
    if len(rig) == 2:
        return _pair_agreement(now, t_us)
    ball = _ball_of(rig, positions_at(now, t_us))
    if ball is None:
        return None
    own = rig[now.view.camera]
    r_px = float(ball_circles(own, ball.p_world_m).r_px[0])
    distance_m = float(np.linalg.norm(ball.p_world_m - own.position_world_m))
    return CameraAgreement(
        ball.residual_px, r_px, distance_m, ball.off_px, frozenset(ball.off_px) - frozenset(ball.cameras)
    )


def _pair_agreement(now: Labelling, t_us: int) -> CameraAgreement | None:
    own, other = now.rig.values()
    here, there = now.here.known(t_us), position_in(now.works[now.others[0].name], t_us)
    if here is None or there is None:
        return None
    check = check_stereo(own, here, other, there)
    residual = float(check.residual_px[0])
    if not np.isfinite(residual):
        return None
    distance_m = float(np.linalg.norm(check.p_world_m[0] - own.position_world_m))
    return CameraAgreement(residual, float(check.expected_r_px[0, 0]), distance_m, {})


def position_in(work: CameraWork, t_us: int) -> Point | None:
    """Where a camera sees the ball: its label, its proposal, or the curve through its labels."""
    known = work.known(t_us)
    if known is not None or t_us in work.labels:
        return known
    near = work.arrays.between(t_us - 4 * NEAR_US, t_us + 4 * NEAR_US)
    x, y = labelled_positions_at(near, np.array([t_us]))[0].tolist() if len(near) else (np.nan, np.nan)
    return (x, y) if np.isfinite(x) else None


def positions_at(now: Labelling, t_us: int) -> dict[str, Position]:
    """Where each calibrated camera has the ball at a time; curves through labels count in the other cameras only."""
    found: dict[str, Position] = {}
    for name in now.rig:
        work = now.works[name]
        point = work.known(t_us) if name == now.view.camera else position_in(work, t_us)
        if point is not None:
            label = work.labels.get(t_us) or work.draft(t_us)
            covariance = None if label is None else label.covariance_px2
            found[name] = Position(x_px=point[0], y_px=point[1], covariance_px2=covariance)
    return found


def reprojected_at(now: Labelling, t_us: int, camera: str, positions: Mapping[str, Position]) -> Reprojection | None:
    """The ball of the other cameras in a camera's picture; None unless two or more have it, and it is one ball."""
    if camera not in now.rig:
        return None
    others = {name: position for name, position in positions.items() if name != camera}
    ball = _ball_of(now.rig, others)
    return None if ball is None or ball.residual_px > ONE_BALL_PX else _reproject(ball, now.rig[camera])


def draft_at(now: Labelling, t_us: int, camera: str = "") -> ProposedLabel | None:
    """What is proposed at a time in a camera, by default the labelled one, and may be seen.

    It is what a detector found or, where that found nothing, the ball that is labelled in two or more other cameras.
    """
    camera = camera or now.view.camera
    work = now.works[camera]
    draft = None if now.view.repeat else work.draft(t_us)
    if draft is not None or now.view.repeat or len(now.rig) < 3:
        return draft
    if t_us in work.labels or (t_us, FROM_OTHERS) in work.rejected:
        return None
    labelled = {}
    for name in now.rig:
        label = now.works[name].labels.get(t_us)
        if label is not None and label.state.seen and label.x_px is not None and label.y_px is not None:
            labelled[name] = Position(x_px=label.x_px, y_px=label.y_px, covariance_px2=label.covariance_px2)
    ball = reprojected_at(now, t_us, camera, labelled)
    return (
        None if ball is None else ProposedLabel(t_us, ball.x_px, ball.y_px, ball.r_px, ball.covariance_px2, FROM_OTHERS)
    )


def expected_at(now: Labelling, t_us: int, camera: str) -> Point | None:
    """Where the ball is in a camera or, from the others or the labels around, may be."""
    work = now.works[camera]
    known = work.known(t_us)
    if known is None and len(now.rig) > 2:
        ball = reprojected_at(now, t_us, camera, positions_at(now, t_us))
        known = None if ball is None else (ball.x_px, ball.y_px)
    return work.expected(t_us) if known is None else known


def _ball_of(rig: Mapping[str, Camera], positions: Mapping[str, Position]) -> BallInSpace | None:
    """The ball at the positions of two cameras or more, from those that were worked out lately if it is there."""
    return _kept_ball(tuple((name, rig[name], position) for name, position in positions.items()))


@lru_cache(maxsize=KEPT)
def _kept_ball(sightings: tuple[tuple[str, Camera, Position], ...]) -> BallInSpace | None:
    return ball_in_space({name: camera for name, camera, _ in sightings}, {name: seen for name, _, seen in sightings})


@lru_cache(maxsize=KEPT)
def _reproject(ball: BallInSpace, camera: Camera) -> Reprojection | None:
    return reproject(ball, camera)
