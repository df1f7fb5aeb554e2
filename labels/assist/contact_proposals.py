"""Contacts proposed from what detectors found in two or more cameras: where the ball's path in space has a kink."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core.cameras import Camera, StereoRig
from core.table import BALL_RADIUS_M
from labels.assist.kinks import ContactProposalConfig, PathPoints, find_kinks
from labels.assist.propose import Proposals
from labels.contacts import kind_at
from labels.model import ContactKind, ContactLabel, PositionSource, Provenance

Array = NDArray[np.float64]


def propose_contacts(
    cameras: Sequence[Camera], proposals: Sequence[Proposals], config: ContactProposalConfig | None = None
) -> tuple[ContactLabel, ...]:
    """Bounces, hits and net touches in what detectors found in two or more calibrated cameras, by time.

    The cameras' world has to be that of the table: it tells a bounce from a hit.
    """
    config = config or ContactProposalConfig()
    points = points_in_space(cameras, proposals, config.tolerance_px)
    detector = next((part.detector for part in proposals), "")
    contacts = []
    for kink in find_kinks(points, config):
        kind = kind_at(kink.p_world_m, kink.v_before_mps, kink.v_after_mps)
        least = config.hit_mps if kind is ContactKind.HIT else config.bounce_mps
        if kind is None or kink.jump_mps < least or kink.t_us < 0:
            continue
        made = Provenance(source=PositionSource.ACCEPTED, detector=detector)
        t_us, sigma_us = round(kink.t_us), round(kink.sigma_us, 1)
        contacts.append(ContactLabel(t_us=t_us, kind=kind, sigma_us=sigma_us, provenance=made))
    return tuple(contacts)


def points_in_space(cameras: Sequence[Camera], proposals: Sequence[Proposals], tolerance_px: float) -> PathPoints:
    """The points on which two or more cameras agree, those of one camera, and how exact each is.

    Times at which cameras disagree by `tolerance_px` or more have no point.
    """
    every = np.unique(np.concatenate([part.t_us for part in proposals] or [np.zeros(0, np.int64)]))
    at = [part.at(every) for part in proposals]
    if not at or not len(every):
        return PathPoints(every, np.empty((0, 3)), np.empty((0, 3, 3)), np.zeros(0, np.bool_))
    views = np.stack([np.column_stack([part.x_px, part.y_px]) for part in at], axis=1)
    seen = np.isfinite(views[:, :, 0])
    p, root = np.full((len(every), 3), np.nan), np.zeros((len(every), 3, 3))
    whole = seen.sum(axis=1) >= 2
    rig = StereoRig({str(row): camera for row, camera in enumerate(cameras)})
    found = rig.triangulate(views[whole])
    fine = np.isfinite(found.ps_world_m).all(axis=1) & (found.residuals_px < tolerance_px)
    precision = np.linalg.inv(found.covariances_m2[fine]) * rig.config.sigma_px**2
    rows = np.flatnonzero(whole)[fine]
    p[rows], root[rows] = found.ps_world_m[fine], np.linalg.cholesky(precision).transpose(0, 2, 1)
    for number, (camera, part) in enumerate(zip(cameras, at, strict=True)):
        alone = np.flatnonzero(seen[:, number] & ~whole & np.isfinite(part.r_px) & (part.r_px > 0))
        p[alone], root[alone] = _on_ray(camera, views[alone, number], part.r_px[alone])
    known = np.isfinite(p).all(axis=1)
    return PathPoints(every[known], p[known], root[known], whole[known])


def _on_ray(camera: Camera, uvs_px: Array, r_px: Array) -> tuple[Array, Array]:
    """(N, 3) points of one camera, at the distance that the ball's radius tells, and (N, 3, 3) their roots, px/m.

    A root says nothing of the distance along the ray: it is the slopes of the pixel, and a row of zeros.
    """
    xys = camera.undistort(uvs_px)
    slopes = camera.pixel_slopes(xys)
    pixels_per_slope = np.sqrt(np.abs(np.linalg.det(slopes)))
    z = pixels_per_slope * BALL_RADIUS_M / r_px
    rays = np.column_stack([xys, np.ones(len(xys))])
    p = camera.position_world_m + (rays * z[:, None]) @ camera.T_world_camera[:3, :3].T
    of_camera = np.zeros((len(xys), 2, 3))  # d(x / z, y / z) / d(x, y, z)
    of_camera[:, 0, 0] = of_camera[:, 1, 1] = 1 / z
    of_camera[:, :, 2] = -xys / z[:, None]
    root = np.zeros((len(xys), 3, 3))
    root[:, :2] = slopes @ of_camera @ camera.T_world_camera[:3, :3].T
    return p, root
