"""The sightings of several cameras at common instants, and a first guess of the rig from them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from core.cameras.calibration.bundle import Rig, Sightings, points_of
from core.cameras.calibration.point_track import PointTrack, common_instants, motion_directions, sample_values
from core.cameras.calibration.relative_pose import RelativePose, guess_relative_pose
from core.cameras.camera import Camera
from core.errors import CalibrationError

Array = NDArray[np.float64]

SEARCH_INSTANTS: Final = 20_000


def sightings_of(tracks: list[PointTrack], cameras: list[Camera], t_us: Array, marker: NDArray[np.int64]) -> Sightings:
    """The sightings of tracks at times (N,) of the first camera's clock, each of a marker (N,)."""
    xys = [camera.undistort(track.uvs_px) for camera, track in zip(cameras, tracks, strict=True)]
    steps = [
        camera.undistort(track.uvs_px + motion_directions(track)) - xy
        for camera, track, xy in zip(cameras, tracks, xys, strict=True)
    ]

    def sample(offsets_us: Array, lead_px: float) -> Array:
        columns = [
            sample_values(track, xy - lead_px * step, marker, t_us + offset)
            for track, xy, step, offset in zip(tracks, xys, steps, offsets_us.tolist(), strict=True)
        ]
        return np.stack(columns, axis=1)

    focals = np.array([(camera.K[0, 0] + camera.K[1, 1]) / 2 for camera in cameras])
    return Sightings(t_us, sample, focals)


def guess_rig(
    tracks: list[PointTrack],
    cameras: list[Camera],
    offsets_us: Array,
    progress: Callable[[float], None] = lambda share: None,
) -> Rig:
    """Each camera against the first, the clocks as far apart as one of `offsets_us`, brought to one scale.

    Raises:
        CalibrationError: if a camera saw too little together with the first.
    """
    sightings = sightings_of(tracks, cameras, *common_instants(tracks[0], SEARCH_INSTANTS))
    others = len(tracks) - 1
    poses: list[RelativePose] = []
    for other in range(1, len(tracks)):

        def second_at(offset_us: float, other: int = other) -> Array:
            return sightings.sample(np.where(np.arange(others + 1) == other, offset_us, 0.0), 0.0)[:, other]

        first = sightings.sample(np.zeros(others + 1), 0.0)[:, 0]
        focal = float(sightings.focals_px[[0, other]].mean())

        def show(share: float, other: int = other) -> None:
            progress((other - 1 + share) / others)

        poses.append(guess_relative_pose(first, second_at, offsets_us, focal, progress=show))
    return _one_scale(poses, sightings)


def _one_scale(poses: list[RelativePose], sightings: Sightings) -> Rig:
    """All cameras in the first one's frame; the first two are 1 apart, the others where depths agree."""
    Rs = np.stack([np.eye(3), *(pose.T_first_second[:3, :3] for pose in poses)])
    ps = np.stack([np.zeros(3), *(pose.T_first_second[:3, 3] for pose in poses)])
    offsets_us = np.array([0.0, *(pose.offset_us for pose in poses)])
    xys = sightings.sample(offsets_us, 0.0)
    depths = []
    for other in range(1, len(ps)):
        pair = [0, other]
        rig = Rig(Rs[pair], ps[pair], offsets_us[pair])
        depths.append(points_of(rig, xys[:, pair], sightings.focals_px[pair])[:, 2])
    for other in range(2, len(ps)):
        ratio = np.nanmedian(depths[0] / depths[other - 1])
        if not np.isfinite(ratio):
            raise CalibrationError("a camera saw nothing together with the first two", got=f"camera number {other + 1}")
        ps[other] *= ratio
    return Rig(Rs, ps, offsets_us)
