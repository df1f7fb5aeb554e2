"""Calibration of n cameras: a ball, a wand, a board; clocks that run apart; a camera that shares too little."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.calibration.bench_rig import (
    MULTIVIEW,
    BallSwing,
    click_corners,
    held_out,
    multiview_rows,
    pose_errors,
    ring,
    seen_by,
    simulated_row,
)
from core.cameras import Camera
from core.cameras.calibration import Board
from core.cameras.calibration.body_tracks import body_tracks, read_points_table
from core.cameras.calibration.bundle import Rig
from core.cameras.calibration.point_track import PointTrack
from core.cameras.calibration.rig import RigConfig, calibrate_rig
from core.cameras.calibration.scale import Scale
from core.errors import CalibrationError

pytestmark = pytest.mark.numeric
CAMERAS = ring(4)
BALL = np.zeros((1, 3))
QUICK = RigConfig(max_offset_ms=3.0, instants=300)
SWING = BallSwing(4.0, middle_m=(0.0, 0.0, 0.4), reach_m=(0.9, 0.6, 0.3))
BASELINE = Scale("baseline", 3.5)


def lenses(cameras: Mapping[str, Camera]) -> dict[str, Camera]:
    return {name: replace(camera, T_world_camera=np.eye(4)) for name, camera in cameras.items()}


def sweep(cameras: Mapping[str, Camera], *, noise_px: float = 0.2, stray: float = 0.01) -> dict[str, PointTrack]:
    rng = np.random.default_rng(0)
    return {
        name: seen_by(camera, SWING, rng, noise_px=noise_px, stray_share=stray, clock_ahead_us=700 * number)
        for number, (name, camera) in enumerate(cameras.items())
    }


@pytest.mark.parametrize(("count", "swept"), [(3, "ball"), (4, "wand")])
def test_poses_and_clocks_of_a_simulated_rig(count: int, swept: str) -> None:
    row = simulated_row(count, swept, [0], sweep_s=4.0, instants=300)
    assert row["place_mm_worst"] < 1.0 and row["turned_deg_worst"] < 0.05
    assert row["clock_us_worst"] < 60 and row["drift_ppm_worst"] < 60
    assert row["place_in_sigmas_worst"] < 4


def test_corners_place_the_rig_at_the_table_and_give_the_scale() -> None:
    clicks = click_corners(CAMERAS, np.random.default_rng(1), 0.5)
    tracks = body_tracks(sweep(CAMERAS), BALL)
    found = calibrate_rig(tracks, lenses(CAMERAS), Scale("table"), clicks=clicks, ball=True, config=QUICK)
    for name, camera in found.cameras.items():
        assert np.linalg.norm(camera.position_world_m - CAMERAS[name].position_world_m) < 0.008
        assert found.reports[name].sigmas["x"] < 0.01
    assert found.click_rms_px is not None and found.click_rms_px < 1.0 and "corners" in found.frame
    assert found.notes == ()


def test_one_wrong_camera_is_left_out_and_the_rest_of_the_instant_is_kept() -> None:
    tracks = sweep(CAMERAS, stray=0.0)
    wrong = tracks["cam2"].uvs_px.copy()
    wrong[200:400] += 40.0
    tracks["cam2"] = replace(tracks["cam2"], uvs_px=wrong)
    found = calibrate_rig(body_tracks(tracks, BALL), lenses(CAMERAS), BASELINE, ball=True, config=QUICK)
    assert found.reports["cam2"].left_out > 10
    assert all(found.reports[name].left_out <= 3 for name in ("cam0", "cam1", "cam3"))
    assert pose_errors(list(found.cameras.values()), list(CAMERAS.values()))[:, 0].max() < 1.5


def test_a_camera_that_sees_nothing_with_the_first_is_chained_over_the_others() -> None:
    tracks = sweep(CAMERAS, stray=0.0)
    early, late = tracks["cam0"].t_us < 2_500_000, tracks["cam3"].t_us > 2_600_000
    tracks["cam0"] = PointTrack.of(tracks["cam0"].t_us[early], tracks["cam0"].uvs_px[early])
    tracks["cam3"] = PointTrack.of(tracks["cam3"].t_us[late], tracks["cam3"].uvs_px[late])
    found = calibrate_rig(body_tracks(tracks, BALL), lenses(CAMERAS), BASELINE, ball=True, config=QUICK)
    assert found.shared[0, 3] == 0
    assert pose_errors(list(found.cameras.values()), list(CAMERAS.values()))[:, 0].max() < 3.0


def test_a_camera_that_shares_too_little_is_named_with_what_to_sweep() -> None:
    tracks = sweep(CAMERAS, stray=0.0)
    tracks["cam3"] = PointTrack.of(tracks["cam3"].t_us[:12], tracks["cam3"].uvs_px[:12])
    with pytest.raises(CalibrationError, match=r"cam3 shares too little.*with cam0.*sweep the ball where cam3 and"):
        calibrate_rig(body_tracks(tracks, BALL, clean=False), lenses(CAMERAS), BASELINE, config=QUICK)


def test_a_board_places_cameras_by_its_own_size() -> None:
    board = Board("chessboard", 5, 7, 0.04)
    points = board.points_m - board.points_m.mean(axis=0)
    rng = np.random.default_rng(2)
    seen = {name: ([], []) for name in CAMERAS}
    for number in range(12):
        R = Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix()
        ps = points @ R.T + rng.uniform((-0.4, -0.3, 0.2), (0.4, 0.3, 0.5))
        for name, camera in CAMERAS.items():
            uvs = camera.project(ps)
            if (uvs > 0).all() and (uvs < (camera.sensor.width_px, camera.sensor.height_px)).all():
                seen[name][0].append(np.full(len(ps), 1_000_000 * number))
                seen[name][1].append(uvs + rng.normal(0, 0.2, uvs.shape))
    size = len(points)
    tracks = {
        name: PointTrack.of(np.concatenate(t_us), np.concatenate(uvs), np.tile(np.arange(size), len(t_us)))
        for name, (t_us, uvs) in seen.items()
    }
    tracks = body_tracks(tracks, board.points_m)
    found = calibrate_rig(tracks, lenses(CAMERAS), config=RigConfig(max_offset_ms=0.0))
    assert pose_errors(list(found.cameras.values()), list(CAMERAS.values()))[:, 0].max() < 10.0
    assert found.sigma_px == pytest.approx(0.2, abs=0.03) and "board" in found.scale.origin


def test_lenses_are_refined_where_asked() -> None:
    wrong = lenses(CAMERAS)
    K = wrong["cam1"].K.copy()
    K[[0, 1], [0, 1]] *= 1.015
    wrong["cam1"] = replace(wrong["cam1"], K=K)
    tracks = body_tracks(sweep(CAMERAS, stray=0.0), BALL)
    kept, fitted = (
        calibrate_rig(tracks, wrong, BASELINE, ball=True, refine_lenses=refine, config=QUICK)
        for refine in (False, True)
    )
    assert np.array_equal(kept.cameras["cam1"].K, K) and kept.sigma_px > 1.15 * fitted.sigma_px
    report = fitted.reports["cam1"]
    assert abs(report.camera.K[0, 0] / 1000 - 1) < 3 * report.sigmas["focal"] < 0.015


def test_a_table_of_points_is_read_and_what_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("camera,time,x,y,sigma\na,0.002,5,6,0.5\na,0.001,3,4,0.25\nb,0.001,1,2,1\n")
    tracks, sigmas = read_points_table(path)
    assert tracks["a"].t_us.tolist() == [1000, 2000] and tracks["a"].uvs_px.tolist() == [[3, 4], [5, 6]]
    assert sigmas["a"].tolist() == [0.25, 0.5] and list(tracks) == ["a", "b"]
    for row in ("a,x,5,6,1", "a,0.1,5,6,0", ",0.1,5,6,1", "a,0.1,nan,6,1"):
        path.write_text(f"camera,time,x,y,sigma\n{row}\n")
        with pytest.raises(CalibrationError, match="line 2"):
            read_points_table(path)


@pytest.mark.skipif(not MULTIVIEW.is_dir(), reason=f"the public wand is not in {MULTIVIEW}")
@pytest.mark.gate
def test_a_public_wand_before_four_real_cameras() -> None:
    rows = {row["case"]: row for row in multiview_rows(MULTIVIEW)}
    fitted = rows["clocks fitted"]
    assert fitted["median_px"] <= 0.5 and fitted["length_spread_percent"] < 1.0
    assert rows["one clock"]["median_px"] > 1.5 * fitted["median_px"], "the first camera's clock is 8 ms ahead"
    assert fitted["length_mm"] == pytest.approx(391.5, rel=0.01)


def test_what_was_held_out_fits_the_true_rig() -> None:
    tracks = body_tracks(sweep(CAMERAS, stray=0.0), BALL)
    clocks = np.array([0.0, 700.0, 1400.0, 2100.0])
    row = held_out(tracks, Rig(tuple(CAMERAS.values()), clocks, np.zeros(4)))
    assert row["median_px"] < 0.3 and row["unseen_median_px"] < 0.6
