"""What several cameras saw of a moving body, asked for at any time."""

import numpy as np
import pytest

from core.cameras.calibration.body_tracks import BodyTracks, body_tracks
from core.cameras.calibration.point_track import PointTrack

pytestmark = pytest.mark.numeric
BALL, WAND = np.zeros((1, 3)), np.array([[0.0, 0, 0], [0.4, 0, 0]])


def path(t_us: np.ndarray) -> np.ndarray:
    """A parabola in the picture."""
    return np.column_stack([3e-3 * t_us, 100 + 1e-8 * np.square(t_us)])


def one_camera(t_us: np.ndarray, marker: np.ndarray | None = None, body_m: np.ndarray = BALL) -> BodyTracks:
    return body_tracks({"a": PointTrack.of(t_us, path(t_us), marker)}, body_m, clean=False)


def test_a_parabola_is_met_between_sightings_and_nothing_far_from_them() -> None:
    tracks = one_camera(np.array([0, 2000, 4000, 6000, 30_000]))
    at = np.array([500.0, 2000.0, 2700.0, 4999.0, 15_000.0])
    found = tracks.sample(at, np.zeros(1), np.zeros(1)).uvs_px[:, 0, 0]
    np.testing.assert_allclose(found[1:4], path(at)[1:4], rtol=1e-12)
    assert np.isnan(found[[0, 4]]).all(), "the first sighting has no motion, and 15 ms is nobody's"


def test_a_clock_ahead_that_drifts_shows_a_later_picture() -> None:
    tracks = one_camera(2000 * np.arange(20))
    at = np.array([10_000.0, 30_000.0])
    found = tracks.sample(at, np.array([700.0]), np.array([5000.0])).uvs_px[:, 0, 0]
    np.testing.assert_allclose(found, path(at + 700.0 + 5e-3 * (at - tracks.middle_us)), rtol=1e-12)
    again = tracks.sample(at, np.zeros(1), np.zeros(1)).by_clocks(np.array([700.0]), np.array([5000.0])).uvs_px[:, 0, 0]
    np.testing.assert_allclose(again, found, rtol=1e-12)


def test_instants_are_sightings_by_the_common_clock() -> None:
    t_us = 2000 * np.arange(20)
    tracks = one_camera(t_us)
    found = tracks.instants(np.array([700.0]), np.array([5000.0]))
    np.testing.assert_allclose(found, t_us - 700.0 - 5e-3 * (t_us - tracks.middle_us), rtol=1e-12)


def test_markers_of_a_body_stand_beside_each_other_and_those_of_none_below() -> None:
    t_us = np.tile(2000 * np.arange(5), 2)
    marker = np.repeat([0, 1], 5)
    at = np.array([2500.0, 4500.0, 99_000.0])
    wand = one_camera(t_us, marker, WAND).sample(at, np.zeros(1), np.zeros(1))
    apart = one_camera(t_us, marker).sample(at, np.zeros(1), np.zeros(1))
    assert wand.uvs_px.shape == (3, 2, 1, 2) and apart.uvs_px.shape == (6, 1, 1, 2)
    assert apart.t_us.tolist() == np.repeat(at, 2).tolist()
    np.testing.assert_array_equal(apart.uvs_px[:, 0], wand.uvs_px.reshape(6, 1, 2))


def test_spread_instants_lie_anywhere_between_sightings() -> None:
    t_us = 2000 * np.arange(200)
    tracks = one_camera(t_us)
    spread = tracks.spread_instants(t_us.astype(float))
    share = spread % 2000 / 2000
    assert np.abs(spread - t_us).max() <= 1000 and (np.diff(spread) > 0).all()
    assert np.histogram(share, 10, (0, 1))[0].min() >= 15, "evenly over the share of the way"
    slow = one_camera(100_000 * np.arange(50))
    assert np.abs(slow.spread_instants(slow.tracks[0].t_us) - slow.tracks[0].t_us).max() <= 3000
