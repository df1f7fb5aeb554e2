from pathlib import Path

import numpy as np
import pytest

from core.cameras.calibration.point_track import (
    PointTrack,
    clean_track,
    motion_directions,
    read_point_track,
)
from core.errors import CalibrationError

pytestmark = pytest.mark.numeric


def line(count: int = 50, step_us: int = 2000) -> PointTrack:
    t_us = np.arange(count) * step_us
    return PointTrack.of(t_us, np.column_stack([3e-3 * t_us, 100 + 1e-8 * t_us**2]))


def test_sightings_come_in_any_order_and_those_that_are_none_are_left_out() -> None:
    track = PointTrack.of([30, 10, 20], [[3, 3], [1, 1], [np.nan, 2]], [0, 0, 0])
    assert track.t_us.tolist() == [10, 30] and track.uvs_px[:, 0].tolist() == [1, 3]


def test_directions_are_along_the_motion_and_none_where_it_is_not_known() -> None:
    t_us = np.array([0, 2000, 4000, 6000, 8000, 900_000])
    track = PointTrack.of(t_us, np.column_stack([3e-3 * t_us, 4e-3 * t_us]))
    found = motion_directions(track)
    np.testing.assert_allclose(found[:3], [[0.6, 0.8]] * 3)
    assert not found[5].any() and not motion_directions(PointTrack.of([0, 1000], [[1, 1], [1, 1]])).any()


def test_all_of_a_clean_run_stays_but_two_sightings_at_each_end() -> None:
    track = line(20)
    cleaned = clean_track(PointTrack.of(track.t_us, track.uvs_px + np.random.default_rng(0).normal(0, 0.01, (20, 2))))
    assert cleaned.t_us.tolist() == track.t_us[2:-2].tolist()
    np.testing.assert_allclose(cleaned.uvs_px, track.uvs_px[2:-2], atol=0.05)


@pytest.mark.parametrize("noise_px", [0.03, 0.3, 3.0])
def test_stray_sightings_go_and_good_ones_stay(noise_px: float) -> None:
    track = line(200)
    rng = np.random.default_rng(0)
    uvs = track.uvs_px + rng.normal(0, noise_px, track.uvs_px.shape)
    uvs[[40, 100]] += 100 * noise_px * np.array([1.0, -0.7])
    cleaned = clean_track(PointTrack.of(track.t_us, uvs))
    assert not {40 * 2000, 100 * 2000} & set(cleaned.t_us.tolist())
    assert 180 < len(cleaned.t_us) < 194, "with each its neighbours and the two at each end"
    assert len(clean_track(line(3)).t_us) == 0 and len(clean_track(PointTrack.of([], [])).t_us) == 0


def test_a_table_of_detections_is_read(tmp_path: Path) -> None:
    path = tmp_path / "det.csv"
    path.write_text("t_us,u_px,v_px,r_px\n4000,2.5,3.5,9\n2000,1.5,2.5,9\n")
    track = read_point_track(path)
    assert track.t_us.tolist() == [2000, 4000] and track.uvs_px.tolist() == [[1.5, 2.5], [2.5, 3.5]]
    path.write_text("t_us,u_px,v_px,marker\n1,2,3,1\n1,5,6,0\n")
    assert read_point_track(path).marker.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,b\n1,2\n", "line 2"),
        ("t_us,u_px,v_px\n1,2,x\n", "line 2"),
        ("t_us,u_px,v_px,marker\n1,2,3,-1\n", "marker 0 to 99"),
        ("t_us,u_px,v_px\ninf,2,3\n", "a time in us"),
        ("t_us,u_px,v_px\n1\n", "line 2"),
    ],
)
def test_what_is_no_table_of_detections_is_refused_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "det.csv"
    path.write_text(text)
    with pytest.raises(CalibrationError, match=says):
        read_point_track(path)
    with pytest.raises(CalibrationError, match="cannot read"):
        read_point_track(tmp_path / "none.csv")
