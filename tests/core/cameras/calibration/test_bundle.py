from dataclasses import replace

import numpy as np
import pytest

from core.cameras import stereo_preset
from core.cameras.calibration.body_tracks import BodyTracks, body_tracks
from core.cameras.calibration.bundle import SIZE, Rig, adjust_rig
from core.cameras.calibration.point_track import PointTrack
from core.geometry import make_transform

pytestmark = pytest.mark.numeric
CAMERAS = stereo_preset("side")
RIG = Rig(tuple(CAMERAS.values()), np.zeros(2), np.zeros(2))
X, OFFSET = SIZE + 3, SIZE + 6
"""Columns of the second camera's place along x and of its clock."""


def only(*columns: int) -> np.ndarray:
    free = np.zeros(2 * SIZE + 1, bool)
    free[list(columns)] = True
    return free


def seen(place, t_us: np.ndarray, noise_px: float, offset_us: float = 0.0, seed: int = 0) -> BodyTracks:
    """A point at `place(t_us)`, seen by a second camera whose clock is ahead by `offset_us`."""
    rng = np.random.default_rng(seed)
    tracks = {}
    for (name, camera), ahead in zip(CAMERAS.items(), (0.0, offset_us), strict=True):
        uvs = camera.project(place(t_us - ahead))
        tracks[name] = PointTrack.of(t_us, uvs + rng.normal(0, noise_px, uvs.shape))
    return body_tracks(tracks, np.zeros((1, 3)), clean=False)


def circling(t_us: np.ndarray) -> np.ndarray:
    angle = 6e-6 * t_us
    return np.column_stack([-0.5 + 0.4 * np.cos(angle), 0.3 * np.sin(angle), 0.3 + 0.2 * np.sin(2 * angle)])


def test_clocks_are_found_by_what_moves_with_the_standard_deviation_of_many_sweeps() -> None:
    found, claimed = [], []
    t_us = np.arange(0, 4_000_000, 20_000)
    at_us = t_us[5:-5].astype(float)
    for seed in range(40):
        tracks = seen(circling, t_us, 0.5, 2500.0, seed)
        adjusted = adjust_rig(tracks, RIG, tracks.spread_instants(at_us), only(OFFSET), lambda rig: np.empty(0))
        found.append(adjusted.rig.offsets_us[1])
        claimed.append(1e3 * np.sqrt(adjusted.covariance[OFFSET, OFFSET]))
        assert adjusted.rig.offsets_us[0] == 0 and np.count_nonzero(adjusted.covariance) == 1
    assert abs(np.mean(found) - 2500.0) < 4 * np.std(found) / np.sqrt(40)
    assert 0.75 < np.std(found) / np.mean(claimed) < 1.33


def test_a_clock_and_a_place_that_trade_for_each_other_are_so_correlated() -> None:
    # What moves along x only: a later picture is the same as a camera farther back along x.
    t_us = np.arange(0, 400_000, 2_000)
    tracks = seen(lambda t: np.column_stack([-1.0 + 2e-6 * t, 0 * t, 0.3 + 0 * t]), t_us, 0.3, seed=5)
    start = CAMERAS["right"].position_world_m[:1]
    adjusted = adjust_rig(
        tracks,
        RIG,
        t_us[2:-2].astype(float),
        only(X, OFFSET),
        lambda rig: 1e3 * (rig.cameras[1].position_world_m[:1] - start),
    )
    a, b = adjusted.covariance[X, X], adjusted.covariance[OFFSET, OFFSET]
    assert adjusted.covariance[X, OFFSET] / np.sqrt(a * b) < -0.5, "2 mm farther back is 1 ms later at 2 m/s"


def test_outliers_are_left_out_and_what_is_held_has_no_variance() -> None:
    t_us = np.arange(300) * 100_000
    ps = np.random.default_rng(0).uniform((-1.1, -0.4, 0.05), (0.0, 0.4, 0.6), (300, 3))
    tracks = seen(lambda t: ps, t_us, 0.3)
    uvs = tracks.tracks[1].uvs_px.copy()
    uvs[::20, 1] += 30.0
    tracks = replace(tracks, tracks=(tracks.tracks[0], replace(tracks.tracks[1], uvs_px=uvs)))
    right = CAMERAS["right"]
    T_wrong = make_transform(right.T_world_camera[:3, :3], right.position_world_m + np.array([0.01, 0.0, -0.01]))
    wrong = replace(RIG, cameras=(CAMERAS["left"], replace(right, T_world_camera=T_wrong)))

    def kept_length(rig: Rig) -> np.ndarray:
        return np.array([1e4 * (rig.baseline - RIG.baseline)])

    free = only(*range(SIZE, SIZE + 6))
    found = adjust_rig(tracks, wrong, t_us.astype(float), free, kept_length, rough_px=1.0)
    used = found.used.any(axis=(1, 2))
    assert not used[::20].any() and used.mean() > 0.93
    assert np.linalg.norm(found.rig.cameras[1].position_world_m - right.position_world_m) < 0.005
    variances = np.diag(found.covariance)[:-1].reshape(2, SIZE)
    assert not variances[0].any() and variances[1, :6].all() and not variances[1, 6:].any()
    assert 0.25 < found.sigma_px < 0.35
